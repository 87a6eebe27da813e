"""
Contact with obstacles
======================

A robot bends around a ball and pushes a plate that slides on a spring. In equilibrium the contact forces on
the plate are the force of its spring.
"""

import exudyn as exu
import exudyn.graphics as graphics
import matplotlib.pyplot as plt
import numpy as np
from exudyn.rigidBodyUtilities import InertiaCuboid

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.report.scene_picture import scene_picture

tdcr.register()  # mbs.CreateTDCR and mbs.SolveTDCR

SPRING = 3.0  # of the plate [N/m]

SC = exu.SystemContainer()
mbs = SC.AddSystem()
robot = Robot(
    name="arm",
    backbone=Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    disks=Disks.equally_spaced(13, 0.25, mass=0.17e-3),
    tendons=(Tendon("pull", ParallelRouting(4.5e-3, angle_deg=0.0), friction_coefficient=0.2),),
)
arm = mbs.CreateTDCR(robot, Model(friction="per-hole", elements_per_bay=2))

# A ball of 20 mm radius on ground, in the way of the middle of the robot.
ground = mbs.CreateGround(
    referencePosition=[0.028, 0.0, 0.1],
    graphicsDataList=[graphics.Sphere(radius=0.02, color=graphics.color.orange, nTiles=48)],
)
ball = arm.add_disk_contact(ground, contactStiffness=5e3, sphereRadius=0.02)

# A plate in front of the tip, which slides along x against a spring.
size = [0.004, 0.05, 0.05]
plate = mbs.CreateRigidBody(
    name="plate",
    referencePosition=[0.052, 0.0, 0.24],
    inertia=InertiaCuboid(density=1000.0, sideLengths=size),
    graphicsDataList=[graphics.Brick(size=size, color=graphics.color.steelblue)],
)
mbs.CreatePrismaticJoint(itemNumbers=[ground, plate], position=[0.052, 0.0, 0.24], axis=[1, 0, 0], show=False)
mbs.CreateCartesianSpringDamper(
    itemNumbers=[ground, plate], localPosition0=[0.024, 0.0, 0.14], stiffness=[SPRING, 0.0, 0.0], show=False
)
corners = [[-0.002, y, z] for y, z in ((-0.025, -0.025), (-0.025, 0.025), (0.025, 0.025), (0.025, -0.025))]
front = arm.add_disk_contact(plate, contactStiffness=5e3, quadPoints=corners)
mbs.Assemble()

for tension in np.linspace(0.125, 1.25, 10):
    arm.set_tensions({"pull": float(tension)})
    report = mbs.SolveTDCR()
    moved = mbs.GetObjectOutputBody(plate, exu.OutputVariableType.Position)[0] - 0.052
    print(
        f"{tension:.3f} N: ball {ball.normal_forces().sum():.4f} N, plate {front.normal_forces().sum():.4f} N and "
        f"{1e3 * moved:.3f} mm, {report['iterations']} iterations"
    )
# The force on the plate is that of its spring; something presses on the ball.
assert abs(front.normal_forces().sum() - SPRING * moved) < 1e-6
assert abs(moved - 3.872e-3) < 2e-5
assert abs(ball.normal_forces().sum() - 0.0314) < 2e-4

plt.imshow(scene_picture(SC, center=[0.03, 0.0, 0.125], height=0.31, azimuth=-1.1, elevation=0.3))
plt.axis("off")
plt.tight_layout()
plt.show()
