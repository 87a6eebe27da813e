"""
Two segments
============

Tendons of the first segment end half-way, those of the second at the tip. Along the backbone and without
friction each segment is an arc of constant curvature: the first carries the moments of both groups, the
second only of its own.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm

import tdcr_fe as tdcr

LENGTH, OFFSET = 0.25, 4.5e-3
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)
robot = tdcr.Robot(
    backbone=backbone,
    disks=tdcr.Disks.equally_spaced(10, LENGTH),
    tendons=(
        tdcr.Tendon(
            "near", tdcr.ParallelRouting(OFFSET, angle_deg=90.0), friction_coefficient=0.2, end=0.5 * LENGTH
        ),
        tdcr.Tendon("far", tdcr.ParallelRouting(OFFSET, angle_deg=0.0), friction_coefficient=0.2),
    ),
)
NEAR, FAR = 3.0, 1.5
steps = [tdcr.LoadStep("both", tensions={"near": NEAR, "far": FAR})]
classical = tdcr.Model(tendon_path="continuous", friction="none")
result = tdcr.simulate(robot, classical, steps).raise_if_failed()


# %%
# The pose at the end of an arc is the exponential of its constant strain: curvature about x and y, and the
# compression.


def arc(about_x: float, about_y: float, pressed: float) -> np.ndarray:
    """Homogeneous matrix of half the backbone under moments [N m] and a compressive force [N]."""
    x, y = about_x / backbone.EI, about_y / backbone.EI
    along = 1.0 - pressed / backbone.EA
    strain = np.array([[0.0, 0.0, y, 0.0], [0.0, 0.0, -x, 0.0], [-y, x, 0.0, along], [0.0, 0.0, 0.0, 0.0]])
    return expm(0.5 * LENGTH * strain)


tip = (arc(-NEAR * OFFSET, FAR * OFFSET, NEAR + FAR) @ arc(0.0, FAR * OFFSET, FAR))[:3, 3]
print(f"tip {np.round(1e3 * result.tips[-1], 3)} mm, closed form {np.round(1e3 * tip, 3)} mm")
assert np.linalg.norm(result.tips[-1] - tip) < 1e-4 * LENGTH

# %%
# With tendons from hole to hole and friction the same tensions bend the robot less.

with_friction = tdcr.simulate(robot, tdcr.Model(), steps).raise_if_failed()

axes = plt.figure(figsize=(5.5, 4.5), layout="constrained").add_subplot(projection="3d")
for found, label in ((result, "two arcs"), (with_friction, "straight tendons, friction 0.2")):
    axes.plot(*(1e3 * found.steps[-1].positions.T), label=label)
axes.plot(*(1e3 * tip), "ko", markersize=4, label="closed form")
axes.set_xlabel("x [mm]")
axes.set_ylabel("y [mm]")
axes.set_zlabel("z [mm]")
axes.legend(loc="upper left")
plt.show()
