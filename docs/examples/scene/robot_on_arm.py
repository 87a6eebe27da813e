"""
A robot on an arm of exudyn.robotics
====================================

A serial manipulator of ``exudyn.robotics`` with two joints carries a tendon-driven robot as its tool. Its joints are
held by springs with dampers. At rest the torque of the first joint balances the weight of arm and tool. Then the
second joint turns by 60 degrees in ``mbs.SolveDynamic``, and the first one balances again.
"""

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import matplotlib.pyplot as plt
import numpy as np
from exudyn.rigidBodyUtilities import HomogeneousTransformation, RotationMatrixX, RotationMatrixY
from exudyn.robotics import Robot as Arm
from exudyn.robotics import RobotBase, RobotLink, RobotTool, StdDH2HT, VRobotLink, VRobotTool

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.report.scene_picture import scene_picture

tdcr.register()  # mbs.CreateTDCR and mbs.SolveTDCR

GRAVITY = [0.0, 0.0, -9.81]
MASS, LENGTH = 0.05, 0.15  # of a link [kg], [m]
STIFFNESS, DAMPING = 40.0, 0.5  # of a joint [N m/rad], [N m s/rad]

SC = exu.SystemContainer()
mbs = SC.AddSystem()

# %%
# The joints turn about the third axis of the base, which lies along -y of the world. The base of the arm and the marker
# that carries it must have the same pose: with another one the joints are open in the reference configuration, and
# no solver closes them.
upright = RotationMatrixX(0.5 * np.pi)
drawing = VRobotLink(
    jointRadius=0.012, jointWidth=0.03, linkWidth=0.015, showCOM=False, linkColor=graphics.color.grey
)
# Exudyn draws a link from joint to joint, so that the last one is drawn with the tool.
last = graphics.Brick([-0.5 * LENGTH, 0.0, 0.0], [LENGTH, 0.015, 0.015], color=graphics.color.grey)
arm = Arm(
    gravity=GRAVITY,
    base=RobotBase(HT=HomogeneousTransformation(upright, [0.0, 0.0, 0.0])),
    tool=RobotTool(visualization=VRobotTool(graphicsData=[last])),
    referenceConfiguration=[0.0, 0.0],
)
for _ in range(2):
    arm.AddLink(
        RobotLink(
            mass=MASS,
            COM=[-0.5 * LENGTH, 0.0, 0.0],
            inertia=np.diag([1e-6, 1e-4, 1e-4]),
            localHT=StdDH2HT([0.0, 0.0, LENGTH, 0.0]),
            PDcontrol=(STIFFNESS, DAMPING),
            visualization=drawing,
        )
    )
foot = mbs.AddMarker(
    eii.MarkerBodyRigid(
        bodyNumber=mbs.CreateGround(), localHT=exu.HT(rotation=upright, translation=[0.0, 0.0, 0.0])
    )
)
made = arm.CreateRedundantCoordinateMBS(mbs, baseMarker=foot, createJointTorqueLoads=False)
links, joints = made["bodyList"], made["springDamperList"]

# %%
# The tool stands at the end of the last link and continues it: its third axis is the first one of the link.
along = upright.T @ RotationMatrixY(0.5 * np.pi)
hand = mbs.AddMarker(
    eii.MarkerBodyRigid(bodyNumber=links[-1], localHT=exu.HT(rotation=along, translation=[0.0, 0.0, 0.0]))
)
robot = Robot(
    name="tool",
    backbone=Backbone(length=0.2, radius=0.5e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    disks=Disks.equally_spaced(10, 0.2, mass=0.17e-3),
    tendons=(
        Tendon("up", ParallelRouting(4.5e-3, angle_deg=180.0), friction_coefficient=0.2),
        Tendon("down", ParallelRouting(4.5e-3, angle_deg=0.0), friction_coefficient=0.2),
    ),
)
tool = mbs.CreateTDCR(robot, Model(friction="per-hole", elements_per_bay=1), baseMarker=hand, gravity=GRAVITY)
# A damper at the tip ends the motion below, and takes no part in its rest.
mbs.CreateCartesianSpringDamper(itemNumbers=[mbs.CreateGround(), tool.mTip], damping=[0.02] * 3, show=False)
mbs.Assemble()


def torque_of_first_joint() -> float:
    """Torque of its spring on the arm, positive upwards [N m]."""
    rotation = mbs.GetObjectOutputBody(links[0], exu.OutputVariableType.RotationMatrix).reshape(3, 3)
    return -STIFFNESS * float(np.arctan2(rotation[2, 0], rotation[0, 0]))


def moment_of_weights() -> float:
    """Moment of the weights of links, backbone and disks about the first joint [N m]."""
    centre = [-0.5 * LENGTH, 0.0, 0.0]
    each = [mbs.GetObjectOutputBody(link, exu.OutputVariableType.Position, centre)[0] for link in links]
    s = (np.arange(2000) + 0.5) / 2000 * robot.backbone.length
    backbone = robot.backbone.mass_per_length * tool.position_at(s)[:, 0].mean() * robot.backbone.length
    disks = robot.disks.mass * tool.position_at(np.array(robot.disks.positions))[:, 0].sum()
    return float(9.81 * (MASS * sum(each) + backbone + disks))


tool.set_tensions({"up": 2.0})
mbs.SolveTDCR()
torque, moment = torque_of_first_joint(), moment_of_weights()
print(f"tip at {np.round(1e3 * tool.tip_position, 2)} mm")
print(f"torque of the first joint {torque:.6f} N m, moment of the weights {moment:.6f} N m")
assert abs(torque - moment) < 1e-4 * moment
plt.imshow(scene_picture(SC, center=[0.25, 0.0, 0.0], height=0.42, azimuth=-1.4, elevation=0.2))
plt.axis("off")
plt.tight_layout()
plt.show()

# %%
# The second joint turns: within a second the rest position of its spring goes to 60 degrees upwards.


def move_rest_position(mbs: exu.MainSystem, t: float) -> bool:
    """Move the rest position of the second joint."""
    x = min(t, 1.0)
    mbs.SetObjectParameter(joints[1], "offset", np.radians(60.0) * x * x * (3.0 - 2.0 * x))
    return True


mbs.SetPreStepUserFunction(move_rest_position)
settings = tool.recommended_settings(1.5, 5e-3)
settings.timeIntegration.verboseMode = 0
settings.solution.file.write = False
mbs.SolveDynamic(settings)
mbs.SetPreStepUserFunction(0)
moved = tool.tip_position
mbs.SolveTDCR()
torque, moment = torque_of_first_joint(), moment_of_weights()
print(
    f"tip after the motion at {np.round(1e3 * moved, 2)} mm, at rest at {np.round(1e3 * tool.tip_position, 2)} mm"
)
print(f"torque of the first joint {torque:.6f} N m, moment of the weights {moment:.6f} N m")
assert abs(torque - moment) < 1e-4 * moment
assert np.linalg.norm(tool.tip_position - moved) < 1e-3
