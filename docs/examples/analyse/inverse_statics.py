"""
Inverse statics
===============

Tensions that take the tip of a robot of two segments along an arc, with friction at every hole. Solved
again as an ordinary loading sequence, they lead through the same points.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon, TensionLimits

LENGTH, MU = 0.25, 0.2
near = [
    Tendon(f"near{k + 1}", ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=MU, end=0.5 * LENGTH)
    for k in range(3)
]
far = [
    Tendon(f"far{k + 1}", ParallelRouting(4.5e-3, 60.0 + 120.0 * k), friction_coefficient=MU)
    for k in range(3)
]
robot = Robot(
    name="two segments",
    backbone=Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=Disks.equally_spaced(10, LENGTH),
    tendons=(*near, *far),
)
model = Model(elements_per_bay=1)

# Targets on an arc of 50 mm radius, 240 mm above the base.
angle = np.radians([0.0, 20.0, 40.0, 60.0])
arc = np.column_stack((0.05 * np.cos(angle), 0.05 * np.sin(angle), np.full(4, 0.24)))
found = tdcr.follow_path(robot, model, arc, TensionLimits(largest=3.0, pretension=0.1))
print(found)
assert all(x.reached for x in found.targets)
assert found.errors.max() <= 1e-4 * LENGTH and found.tensions.min() >= 0.1

# The loading sequence, solved again, goes through the same points.
again = tdcr.simulate(robot, model, found.steps).raise_if_failed()
assert np.linalg.norm(again.tips - arc, axis=1).max() <= 1e-4 * LENGTH
# The same tensions on a robot without friction miss the arc.
smooth = tdcr.simulate(robot, Model(friction="none", elements_per_bay=1), found.steps)
miss = 1e3 * np.linalg.norm(smooth.tips - arc, axis=1)
print(
    f"without friction the same tensions end {miss.mean():.1f} mm away on average, {miss.max():.1f} mm at most"
)

# %%
# The arc with and without friction, and the tensions along it.

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
turn = np.linspace(0.0, angle[-1], 200)
left.plot(50.0 * np.cos(turn), 50.0 * np.sin(turn), color="0.8", linewidth=4.0, label="arc")
left.plot(*(1e3 * again.tips[:, :2].T), "ko", markersize=5, label="tip, with friction")
left.plot(*(1e3 * smooth.tips[:, :2].T), "C3.-", linewidth=0.8, label="same tensions, no friction")
left.set_aspect("equal")
left.set_xlabel("x [mm]")
left.set_ylabel("y [mm]")
left.set_xlim(0.0, 60.0)
left.legend(fontsize=8, loc="lower left")
number = np.arange(1, 5)
for k, name in enumerate(robot.tendon_names):
    right.plot(number, found.tensions[:, k], "-" if k < 3 else "--", color=f"C{k % 3}", label=name)
right.axhline(0.1, color="0.7", linewidth=0.8)
right.set_xlabel("target")
right.set_ylabel("tension [N]")
right.legend(fontsize=8, ncols=2)
plt.show()
