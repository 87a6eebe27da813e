"""
A first robot
=============

The robot of the paper, a wire with 13 disks and one tendon, is pulled to 2.5 N and released. An independent
program for the same equations, which shoots along the rod and shares no code with the finite elements, gives
the same angle.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe.validation.reference import solve_reference

robot = tdcr.Robot(
    name="single-segment",
    backbone=tdcr.Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=tdcr.Disks.equally_spaced(13, 0.25),
    tendons=(tdcr.Tendon("t1", tdcr.ParallelRouting(offset=4.5e-3), friction_coefficient=0.3),),
)
pulled = [tdcr.LoadStep(f"pull {t} N", tensions={"t1": t}) for t in (0.5, 1.0, 1.5, 2.0, 2.5)]
released = [tdcr.LoadStep(f"release to {t} N", tensions={"t1": t}) for t in (2.0, 1.5, 1.0, 0.5, 0.0)]
model = tdcr.Model(friction="per-hole")
result = tdcr.simulate(robot, model, pulled + released).raise_if_failed()
print(result)

# %%
# A step of the result has the shape, the tensions of all segments, and the state of every hole.

for step in result.steps:
    angle = np.degrees(step.bending_angle)
    print(f"{step.label:18} {angle:7.3f} deg   {step.tensions[0][-1]:.4f} N at the tip")

# %%
# The reference, up to 2.5 N.

reference = np.degrees(solve_reference(robot, model, pulled).bending_angles[-1])
angle = np.degrees(result.bending_angles[4])
print(f"{angle:.3f} degrees, reference {reference:.3f}")
assert abs(angle - reference) < 0.005

figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
for step in result.steps[::2]:
    axes.plot(1e3 * step.positions[:, 0], 1e3 * step.positions[:, 2], label=step.label)
axes.set_xlabel("x [mm]")
axes.set_ylabel("z [mm]")
axes.set_aspect("equal")
axes.legend()
plt.show()
