"""A robot on ground: pull a tendon, load the tip, read the results.

With the name of a picture it draws one: ``python robot_on_ground.py picture.png``.
"""

import sys
from math import degrees

import exudyn as exu
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon

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
tangent = arm.tip_rotation[:, 2]
angle = degrees(np.arctan2(np.hypot(tangent[0], tangent[1]), tangent[2]))
print(f"pushed: tip at {np.round(1e3 * arm.tip_position, 2)} mm, bending angle {angle:.3f} deg")
assert abs(angle - 52.316) < 0.005
for name, tension in arm.tensions().items():
    print(f"{name}: {tension[0]:.3f} N at the base, {tension[-1]:.3f} N at the tip", arm.hole_states()[name])

points = arm.position_at(np.linspace(0.0, 0.25, 11))
print("every 25 mm of the backbone, in mm:\n", np.round(1e3 * points, 2))

if len(sys.argv) > 1:
    from picture import save_picture

    save_picture(SC, sys.argv[1], center=[0.05, 0.0, 0.11], height=0.24, azimuth=-1.1)
