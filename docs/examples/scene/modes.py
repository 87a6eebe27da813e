"""
Modes of a bent robot
=====================

Small vibrations of a robot that three tendons hold, about its state at rest. A vibration that is small enough moves no
tendon through a hole with friction beyond its presliding: the holes stick, and the robot is stiffer than without
friction.
"""

import exudyn as exu
import matplotlib.pyplot as plt

import tdcr_fe as tdcr
from tdcr_fe.report.scene_picture import scene_picture

tdcr.register()

robot = tdcr.Robot(
    tdcr.Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    tdcr.Disks.equally_spaced(13, 0.25, mass=0.17e-3, radius=5e-3),
    tuple(
        tdcr.Tendon(f"t{k}", tdcr.ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=0.3)
        for k in range(3)
    ),
)
SC = exu.SystemContainer()
mbs = SC.AddSystem()
arm = mbs.CreateTDCR(robot, tdcr.Model(friction="per-hole", elements_per_bay=1))
mbs.Assemble()
arm.set_tensions([1.0, 0.2, 0.2])
mbs.SolveTDCR()

stuck = tdcr.TDCREigenvalues(mbs, numberOfEigenvalues=4)
sliding = tdcr.TDCREigenvalues(mbs, numberOfEigenvalues=4, holes="sliding")
print("holes stuck:  ", " ".join(f"{f:.3f}" for f in stuck.frequencies), "Hz")
print("holes sliding:", " ".join(f"{f:.3f}" for f in sliding.frequencies), "Hz")
assert abs(stuck.frequencies[0] / 4.86 - 1.0) < 5e-3
assert stuck.frequencies[0] > 1.3 * sliding.frequencies[0]

# %%
# ``modes.show`` puts the scene into a mode, ``modes.hide`` takes it away again. From the left the state at rest and the
# first four modes with stuck holes, each with an amplitude that is easily seen.

view = {"center": [0.02, 0.0, 0.12], "height": 0.3, "azimuth": -0.9, "elevation": 0.35, "size": (360, 480)}
figure, axes = plt.subplots(1, 5, figsize=(9.0, 3.0), layout="constrained")
axes[0].imshow(scene_picture(SC, **view))
axes[0].set_title("at rest")
for number, axis in enumerate(axes[1:]):
    stuck.show(mbs, number, 0.08)
    axis.imshow(scene_picture(SC, **view))
    axis.set_title(f"{stuck.frequencies[number]:.2f} Hz")
    stuck.hide(mbs, number, 0.08)
for axis in axes:
    axis.axis("off")
plt.show()
