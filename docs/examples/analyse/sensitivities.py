"""
Sensitivities along the history
===============================

How much parameters move the tip along pulling and release, and how stiff the robot is in both directions. The
derivatives come from the same run; one of them is compared with the central difference of two others.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, LoadStep, Model, ParallelRouting, Robot, Tendon

robot = Robot(
    name="arm",
    backbone=Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    disks=Disks.equally_spaced(13, 0.25, mass=0.17e-3),
    tendons=tuple(
        Tendon(f"t{k + 1}", ParallelRouting(4.5e-3, angle_deg=120.0 * k), friction_coefficient=0.3)
        for k in range(3)
    ),
)
pulled = [*np.linspace(0.25, 2.0, 8), *np.linspace(1.75, 0.25, 7)]
steps = [LoadStep(f"{t:g} N", tensions={"t1": float(t), "t2": 0.2, "t3": 0.2}) for t in pulled]
names = ("backbone.youngs_modulus", "tendons.friction_coefficient", "tendons.t1.offset", "inputs.t1")
result = tdcr.simulate(
    robot, Model(gravity=(0.0, 0.0, -9.81)), steps, sensitivities=names, responses=True
).raise_if_failed()

# Motion of the tip along x for one percent more of each parameter.
for name in names[:3]:
    by = result.sensitivities[name]
    percent = 1e3 * 0.01 * by.value * by.tips[:, 0]
    print(f"1 % more {name}: {percent[7]:+.3f} mm at 2 N, {percent[-4]:+.3f} mm at 1 N on the way back")
friction = result.sensitivities["tendons.friction_coefficient"]
assert friction.tips[7, 0] < 0.0 < friction.tips[-4, 0]  # friction holds the tendon back in both directions
assert abs(1e3 * 0.003 * friction.tips[7, 0] + 0.118) < 0.001

here, reversal = result.steps[7].responses
print(f"at 2 N, tip by tension of t1: {1e3 * here.by_tension[0, 0]:.1f} mm/N going on,", end=" ")
print(f"{1e3 * reversal.by_tension[0, 0]:.1f} mm/N at first when let out")
print(f"tip compliance along x and y: {1e3 * np.diag(here.compliance)[:2].round(4)} mm/N")

# %%
# The central difference: everything solved twice more, with the coefficient of friction 0.001 higher and
# lower.

higher, lower = (
    tdcr.simulate(
        robot.with_tendons(friction_coefficient=0.3 + d), Model(gravity=(0.0, 0.0, -9.81)), steps
    ).tips[:, 0]
    for d in (1e-3, -1e-3)
)
difference = (higher - lower) / 2e-3
print(f"by friction at 2 N: {friction.tips[7, 0]:.6f} m, difference of two runs {difference[7]:.6f} m")
assert np.abs(friction.tips[:, 0] - difference).max() < 0.01 * np.abs(difference).max()

# %%
# Sensitivities along the history, and the compliance of the tip in the plane of bending.

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
number = np.arange(1, len(steps) + 1)
for name in names[:3]:
    by = result.sensitivities[name]
    left.plot(number, 1e3 * 0.01 * by.value * by.tips[:, 0], marker="o", markersize=3, label=name)
left.axhline(0.0, color="0.7", linewidth=0.8)
left.axvline(8.0, color="0.7", linewidth=0.8, linestyle="--")
left.set_xlabel("load step (2 N at step 8, then released)")
left.set_ylabel("tip x for 1 % more [mm]")
left.set_ylim(-1.4, 2.2)
left.legend(fontsize=8, loc="upper right")
circle = np.array([np.cos(angle := np.linspace(0.0, 2.0 * np.pi, 200)), np.sin(angle)])
for found, label in zip(result.steps[7].responses, ("holes as they are", "all holes stick"), strict=True):
    plane = found.compliance[np.ix_((0, 2), (0, 2))]
    right.plot(*(1e3 * 0.01 * plane @ circle), label=label)
right.set_aspect("equal")
right.set_xlabel("tip x [mm]")
right.set_ylabel("tip z [mm]")
right.set_title("motion under 10 mN in any direction, at 2 N", fontsize=9)
right.legend(fontsize=8)
plt.show()
