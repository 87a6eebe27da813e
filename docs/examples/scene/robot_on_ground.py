"""
A robot on ground
=================

``mbs.CreateTDCR`` adds a robot to an Exudyn system. Here three tendons are pulled, the tip is pushed, and the
results are read from the handle. The same sequence through ``tdcr.simulate``, without a scene, gives the same
shape.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.report.scene_picture import scene_picture

tdcr.register()  # mbs.CreateTDCR and mbs.SolveTDCR

SC = exu.SystemContainer()
mbs = SC.AddSystem()

robot = Robot(
    name="arm",
    backbone=Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    disks=Disks.equally_spaced(13, 0.25, mass=0.17e-3),
    tendons=tuple(
        Tendon(f"t{k + 1}", ParallelRouting(4.5e-3, angle_deg=120.0 * k), friction_coefficient=0.3)
        for k in range(3)
    ),
)
arm = mbs.CreateTDCR(robot, Model(friction="per-hole"))
push = arm.add_load("push", at=0.25)
mbs.Assemble()

arm.set_tensions({"t1": 2.0, "t2": 0.5, "t3": 0.5})
report = mbs.SolveTDCR()
print(f"pulled: tip at {np.round(1e3 * arm.tip_position, 2)} mm, {report['iterations']} iterations")

push.set([0.0, 0.02, 0.0])
mbs.SolveTDCR()
print(f"pushed: tip at {np.round(1e3 * arm.tip_position, 2)} mm")
for name, tension in arm.tensions().items():
    print(f"{name}: {tension[0]:.3f} N at the base, {tension[-1]:.3f} N at the tip", arm.hole_states()[name])

points = arm.position_at(np.linspace(0.0, 0.25, 11))
print("every 25 mm of the backbone, in mm:\n", np.round(1e3 * points, 2))

# %%
# Without a scene: two load steps, the same numbers.

steps = [
    LoadStep("pulled", tensions={"t1": 2.0, "t2": 0.5, "t3": 0.5}),
    LoadStep("pushed", loads={"push": Load(at=0.25, force=(0.0, 0.02, 0.0))}),
]
alone = tdcr.simulate(robot, Model(friction="per-hole", elements_per_bay=2), steps).raise_if_failed()
difference = np.linalg.norm(alone.tips[-1] - arm.tip_position)
print(f"difference of both tips {1e6 * difference:.3f} um")
assert difference < 1e-4 * 0.25

plt.imshow(scene_picture(SC, center=[0.05, 0.0, 0.11], height=0.24, azimuth=-1.1))
plt.axis("off")
plt.tight_layout()
plt.show()
