"""
Tracking under load and friction
================================

Three motors with inertia pull a robot whose tip should draw a circle and a star, under a load that the
controller does not know, past a ball that it does not know either. Load cells are noisy, and a camera sees
the tip twice a second. `Tracker` estimates the load and finds the tensions, once with friction in its model
and once without.
"""

import exudyn as exu
import exudyn.itemInterface as eii
import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon

tdcr.register()

LENGTH, NAMES = 0.25, ("t1", "t2", "t3")
RATE, CAMERA = 10.0, 5  # samples a second, and how many of them to a picture of the tip
LAG = 0.075  # of the tip behind the tensions, by the air and the motors; a side of the star shows it [s]
REST, APPROACH, PERIOD = 1.0, 1.5, 16.0  # under load; to the path; once around it [s]
DRUM = 8e-3  # radius of the motors' drums [m]
LIMITS = tdcr.TensionLimits(largest=5.0, pretension=0.5)
LOAD = np.array([0.02, -0.015, -0.02])  # at the tip [N]


def robot(friction):
    tendons = [
        Tendon(n, ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=friction, axial_stiffness=2000.0)
        for k, n in enumerate(NAMES)
    ]
    backbone = Backbone(LENGTH, 0.5e-3, 85e9, 0.3, density=5600.0, retardation_time=8e-3)
    return Robot(backbone, Disks.equally_spaced(10, LENGTH, mass=0.1e-3), tuple(tendons))


def on_path(corners, time):
    """Where the tip should be in the plane: from the axis to the first corner, then around all of them [m]."""
    begin = np.linspace(0.0, APPROACH, 2)
    around = APPROACH + np.linspace(0.0, PERIOD, len(corners))[1:]
    points = np.vstack(([0.0, 0.0], corners, corners[:1]))[: len(corners) + 1]
    return np.array([np.interp(time, [*begin, *around], x) for x in points.T])


def follow(corners, friction):
    """Positions of the tip and where it should be, in every sample [m]."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    arm = mbs.CreateTDCR(robot(0.2), Model(elements_per_bay=1))
    fixed = mbs.AddMarker(
        eii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(eii.NodePointGround()), coordinate=0)
    )
    torques = []
    for name in NAMES:
        motor = arm.add_motor(name, inertia=2e-6, radius=DRUM)
        marker = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=motor, coordinate=0))
        torques.append(mbs.AddLoad(eii.LoadCoordinate(markerNumber=marker, load=0.0)))
        mbs.AddObject(eii.CoordinateSpringDamper(markerNumbers=[fixed, marker], damping=3e-4))
    ground = mbs.CreateGround(referencePosition=[-0.045, -0.03, 0.15])
    arm.add_disk_contact(ground, contactStiffness=200.0, sphereRadius=0.02)
    air = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground))
    mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=[air, arm.mTip], damping=[0.03] * 3))
    tip_load = mbs.AddLoad(eii.LoadForceVector(markerNumber=arm.mTip, loadVector=[0, 0, 0]))
    mbs.Assemble()

    model = Model(friction="per-hole" if friction else "none", elements_per_bay=1)
    estimator = tdcr.Estimator(
        robot(0.2 if friction else 0.0),
        model,
        tdcr.LoadPrior(sigma=0.02, random_walk=0.02),
        tdcr.InputPrior(sigma=0.01, correlation_time=0.0),
    )
    tracker = tdcr.Tracker(estimator, LIMITS, largest_change=0.3)
    rng, samples, commands = np.random.default_rng(0), [], [np.full(3, 0.5)] * 2

    def sample(time):
        """Measure, and command the tensions that are reached one sample later."""
        position = np.array(mbs.GetNodeOutput(arm.nNodes[-1], exu.OutputVariableType.Position))
        samples.append((*position[:2], *on_path(corners, time)))
        cells = [float(arm.tensions()[n][0]) + 0.01 * rng.standard_normal() for n in NAMES]
        seen = position + 2e-4 * rng.standard_normal(3)
        # Estimator and search are quasi-static: at rest under the present tensions the tip would be a lag ahead.
        seen[:2] += on_path(corners, time + LAG) - on_path(corners, time)
        readings = [
            tdcr.Reading(0, f"position_{a}", LENGTH, float(x), 5e-4) for a, x in zip("xyz", seen, strict=True)
        ]
        step = tdcr.LoadStep(tensions={n: max(x, 0.0) for n, x in zip(NAMES, cells, strict=True)}, time=time)
        goal = tdcr.TipTarget((*on_path(corners, time + 1.0 / RATE + LAG), None))
        found = tracker.step(step, readings if len(samples) % CAMERA == 1 else [], goal)
        commands.append(np.array([found.command.tensions[n] for n in NAMES]))

    def before_step(mbs, time):
        phase = (time - REST) * RATE
        if phase >= len(samples) - 1e-6:
            sample(len(samples) / RATE)
        part = np.clip(phase - len(samples) + 1.0, 0.0, 1.0)
        for load, old, new in zip(torques, *commands[-2:], strict=True):
            mbs.SetLoadParameter(load, "load", DRUM * float(old + part * (new - old)))
        mbs.SetLoadParameter(tip_load, "loadVector", (LOAD * min(1.0, 2.0 * time / REST)).tolist())
        return True

    mbs.SetPreStepUserFunction(before_step)
    settings = arm.recommended_settings(REST + APPROACH + PERIOD, 0.01)
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.6
    settings.solution.file.write = False
    mbs.SolveDynamic(settings)
    return np.array(samples)


turn = 2.0 * np.pi * np.linspace(0.0, 1.0, 61)
circle = 0.07 * np.column_stack((np.cos(turn), np.sin(turn)))
spikes = 2.0 * np.pi * np.linspace(0.0, 1.0, 11)
star = np.where(np.arange(11) % 2, 0.04, 0.07)[:, None] * np.column_stack((np.cos(spikes), np.sin(spikes)))

figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.6), sharey=True, layout="constrained")
for ax, (name, corners) in zip(axes, {"circle": circle, "star": star}.items(), strict=True):
    ax.plot(*(1e3 * corners.T), color="0.8", linewidth=5.0, label="path")
    errors = {}
    for friction in (True, False):
        found = follow(corners, friction)
        around = found[int((APPROACH + 0.5) * RATE) :]
        errors[friction] = np.sqrt(np.mean(np.sum((around[:, :2] - around[:, 2:]) ** 2, axis=1)))
        label = (
            f"{'with' if friction else 'without'} friction in the controller: {1e3 * errors[friction]:.1f} mm"
        )
        ax.plot(*(1e3 * found[:, :2].T), color="C0" if friction else "C3", linewidth=1.2, label=label)
        print(f"{name}, {label}")
    print(f"{name}: ratio {errors[True] / errors[False]:.2f}")
    assert errors[True] < 0.01 * LENGTH and errors[True] < 0.35 * errors[False]
    ax.set_title(name)
    ax.set_aspect("equal")
    ax.set_xlabel("x [mm]")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), fontsize=8)
axes[0].set_ylabel("y [mm]")
plt.show()
