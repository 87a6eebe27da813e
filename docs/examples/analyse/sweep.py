"""
A sweep: uncertainty of the bending angle
=========================================

Radius and modulus of the backbone are known to one and two percent. A sweep over 64 samples gives the
standard deviation of the bending angle; exact sensitivities predict it to first order.
"""

from math import degrees, hypot

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

robot = tdcr.Robot(
    backbone=tdcr.Backbone(length=0.2, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=tdcr.Disks.equally_spaced(4, 0.2),
    tendons=(tdcr.Tendon("t1", tdcr.ParallelRouting(4.5e-3), friction_coefficient=0.1),),
)
model, steps = tdcr.Model(elements_per_bay=1), [tdcr.LoadStep(tensions={"t1": 1.0})]
#: Relative standard deviations.
tolerances = {"backbone.radius": 0.01, "backbone.youngs_modulus": 0.02}
contents = {
    "robot": robot,
    "model": model,
    "steps": steps,
    "sampling": {"method": "sobol", "samples": 64, "seed": 3},
    "vary": [
        {"key": key, "mode": "factor", "normal": {"mean": 1.0, "std": std}} for key, std in tolerances.items()
    ],
}

if __name__ == "__main__":  # worker processes import this file again
    result = tdcr.sweep(contents, processes=2)
    print(result)
    assert result.converged
    sampled = result.cases["bending_angle_deg"].std()

    found = tdcr.simulate(robot, model, steps, sensitivities=list(tolerances)).sensitivities.values()
    linear = hypot(
        *(degrees(np.linalg.norm(by.rotations[-1, -1])) * by.value * tolerances[by.parameter] for by in found)
    )
    print(f"standard deviation of the angle: {sampled:.3f} degrees sampled, {linear:.3f} to first order")
    assert abs(sampled / linear - 1.0) < 0.05

    figure, axes = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    axes.hist(result.cases["bending_angle_deg"], bins=16)
    axes.set_xlabel("bending angle [deg]")
    axes.set_ylabel("cases")
    plt.show()
