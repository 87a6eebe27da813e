"""
A robot on a carriage
=====================

A spring acts on the carriage along its rail, and the robot carries a ball at its tip. First the scene is
solved at rest, step by step, with ``mbs.SolveTDCR``; then the carriage is pushed along the rail and the
tendon released in ``mbs.SolveDynamic``. The friction history continues through both. At rest the push on the
carriage is the force of its spring, whatever the robot does.
"""

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import matplotlib.pyplot as plt
import numpy as np
from exudyn.rigidBodyUtilities import InertiaCuboid, InertiaSphere

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.report.scene_picture import scene_picture

tdcr.register()  # mbs.CreateTDCR and mbs.SolveTDCR

GRAVITY = (0.0, 0.0, -9.81)
STIFFNESS = 4.0  # of the carriage's spring [N/m]

SC = exu.SystemContainer()
mbs = SC.AddSystem()
ground = mbs.CreateGround(
    graphicsDataList=[graphics.Brick([0.0, 0.0, -0.035], [0.3, 0.02, 0.01], color=graphics.color.grey)]
)

# The carriage, 30 mm high, its top at z = 0; it runs along x.
size = [0.05, 0.04, 0.03]
carriage = mbs.CreateRigidBody(
    name="carriage",
    referencePosition=[0.0, 0.0, -0.015],
    inertia=InertiaCuboid(density=800.0, sideLengths=size),
    gravity=list(GRAVITY),
    graphicsDataList=[graphics.Brick(size=size, color=graphics.color.steelblue)],
)
mbs.CreatePrismaticJoint(itemNumbers=[ground, carriage], position=[0, 0, -0.03], axis=[1, 0, 0], show=False)
mbs.CreateCartesianSpringDamper(
    itemNumbers=[ground, carriage],
    localPosition0=[0.0, 0.0, -0.015],
    stiffness=[STIFFNESS, 0.0, 0.0],
    damping=[0.8, 0.0, 0.0],
    show=False,
)
top = mbs.AddMarker(eii.MarkerBodyRigid(name="top", bodyNumber=carriage, localPosition=[0.0, 0.0, 0.015]))

robot = Robot(
    name="arm",
    backbone=Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=5600.0),
    disks=Disks.equally_spaced(13, 0.25, mass=0.17e-3),
    tendons=(
        Tendon("left", ParallelRouting(4.5e-3, angle_deg=180.0), friction_coefficient=0.2),
        Tendon("right", ParallelRouting(4.5e-3, angle_deg=0.0), friction_coefficient=0.2),
    ),
)
arm = mbs.CreateTDCR(robot, Model(friction="per-hole", elements_per_bay=1, gravity=GRAVITY), baseMarker=top)

# The ball, its centre 10 mm beyond the tip, joined to it; and the drag of air on it.
ball = mbs.CreateRigidBody(
    name="ball",
    referencePosition=[0.0, 0.0, 0.26],
    inertia=InertiaSphere(mass=2e-3, radius=8e-3),
    gravity=list(GRAVITY),
    graphicsDataList=[graphics.Sphere(radius=8e-3, color=graphics.color.orange, nTiles=48)],
)
hold = mbs.AddMarker(eii.MarkerBodyRigid(name="hold", bodyNumber=ball, localPosition=[0.0, 0.0, -0.01]))
mbs.CreateGenericJoint(itemNumbers=[arm.mTip, hold], show=False)
mbs.CreateCartesianSpringDamper(itemNumbers=[ground, ball], damping=[0.02] * 3, show=False)

push = mbs.AddLoad(eii.Force(markerNumber=top, loadVector=[0.0, 0.0, 0.0]))
mbs.Assemble()


def carriage_at() -> float:
    """Position of the carriage on its rail [m]."""
    return float(mbs.GetObjectOutputBody(carriage, exu.OutputVariableType.Position)[0])


arm.set_tensions({"left": 0.3, "right": 1.5})
mbs.SolveTDCR()
mbs.SetLoadParameter(push, "loadVector", [0.12, 0.0, 0.0])
mbs.SolveTDCR()
rest = arm.tip_position
print(f"at rest: carriage at {1e3 * carriage_at():.4f} mm, tip at {np.round(1e3 * rest, 3)} mm")
# At rest the spring alone balances the push.
assert abs(carriage_at() - 0.12 / STIFFNESS) < 1e-9
plt.imshow(scene_picture(SC, center=[0.06, 0.0, 0.1], height=0.32, azimuth=-1.2))
plt.axis("off")
plt.tight_layout()
plt.show()

# %%
# Dynamics: within two seconds the push goes from 0.12 N to -0.12 N, the right tendon from 1.5 N to 0.8 N.


def share(t: float) -> float:
    """A smooth step from 0 to 1 in two seconds."""
    x = min(t / 2.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def pushed(mbs: exu.MainSystem, t: float, load: list[float]) -> list[float]:
    """The push [N]."""
    return [0.12 - 0.24 * share(t), 0.0, 0.0]


mbs.SetLoadParameter(push, "loadVectorUserFunction", pushed)
arm.set_inputs_over_time(lambda t: [0.3, 1.5 - 0.7 * share(t)])
settings = exu.SimulationSettings()
settings.timeIntegration.numberOfSteps = 600
settings.timeIntegration.endTime = 3.0
settings.timeIntegration.generalizedAlpha.spectralRadius = 0.6
settings.timeIntegration.verboseMode = 0
settings.solution.file.write = False
mbs.SolveDynamic(settings)
moved = arm.tip_position
print(f"after the motion: carriage at {1e3 * carriage_at():.3f} mm, tip at {np.round(1e3 * moved, 3)} mm")

# The equilibrium is a few hundredths of a millimetre from the end of the dynamics.
mbs.SolveTDCR()
again = arm.tip_position
print(f"at rest again: carriage at {1e3 * carriage_at():.4f} mm, tip at {np.round(1e3 * again, 3)} mm")
assert abs(carriage_at() + 0.12 / STIFFNESS) < 1e-9
assert np.linalg.norm(again - moved) < 0.1e-3
