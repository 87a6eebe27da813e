"""The same robots without friction in other codes: the time that each takes to come within 0.1 % of the length.

``pip install '.[peers]'``, then ``python docs/peers.py`` prints a table of the page "Validation" within some
minutes. Every code solves the discretisations and settings below, from coarse to fine; its time is the least of
those whose tip is near enough. The limit is the tip of the shooting reference. Codes without a static solver move the
robot with masses and damping chosen for speed until it is at rest.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, ParallelRouting, Robot, Tendon, simulate
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]

LENGTH, RADIUS = 0.25, 0.4e-3
BACKBONE = Backbone(LENGTH, RADIUS, 85e9, 0.3)
NEAR = 1e-3  # of the length
LONGEST = 120.0  # after a run that takes longer, no further settings are tried [s]


@dataclass(frozen=True)
class Case:
    """A robot under its largest load."""

    name: str
    robot: Robot
    step: LoadStep

    @cached_property
    def tip(self) -> Array:
        """Of the reference [m]."""
        return solve_reference(self.robot, Model(friction="none"), [self.step]).steps[-1].tip

    @property
    def force(self) -> Array:
        """At the tip [N]."""
        return np.array(self.step.loads["tip"].force) if self.step.loads else np.zeros(3)

    @property
    def tendons(self) -> list[tuple[float, Array]]:
        """Tension [N], and holes in their sections [m], shape (k + 1, 2)."""
        return [(self.step.tensions[t.name], self.robot.holes(t)) for t in self.robot.tendons]


def cases() -> list[Case]:
    """A rod, one tendon, and two segments with six tendons."""

    def tendons(count: int, end: float | None, turn: float = 0.0) -> list[Tendon]:
        numbers = range(1, count + 1)
        return [
            Tendon(f"{'proximal' if end else 't'}{k}", ParallelRouting(4.5e-3, turn + 360.0 * (k - 1) / count), end=end)
            for k in numbers
        ]  # fmt: skip

    rod = Robot(BACKBONE)
    one = Robot(BACKBONE, Disks.equally_spaced(13, LENGTH), tuple(tendons(1, None)))
    two = Robot(
        BACKBONE,
        Disks.equally_spaced(12, LENGTH),
        (*tendons(3, None), *tendons(3, LENGTH / 2, 60.0)),
    )
    pulled = {"t1": 2.0, "t2": 0.2, "t3": 0.1, "proximal1": 0.1, "proximal2": 2.5, "proximal3": 0.2}
    return [
        Case(
            "rod, 0.1 N at its tip (3.7 EI/L²)", rod, LoadStep(loads={"tip": Load(LENGTH, (0.1, 0.0, 0.0))})
        ),
        Case("13 disks, one tendon, 2.5 N", one, LoadStep(tensions={"t1": 2.5})),
        Case("two segments, six tendons", two, LoadStep(tensions=pulled)),
    ]


# --------------------------------------------------------------------------------------------------- this package


def this_package(case: Case) -> Iterable[tuple[str, Callable[[], Array]]]:
    """Default settings on fixed meshes, from the description to the result."""
    for elements in (1, 2, 4):

        def solve(elements: int = elements) -> Array:
            model = Model.default_for(case.robot)
            result = simulate(
                case.robot, replace(model, friction="none", elements_per_bay=elements), [case.step]
            )
            return result.steps[-1].tip

        yield f"{elements} elements per bay", solve


# ------------------------------------------------------------------------------------------- Exudyn's own items


def exudyn_items(case: Case) -> Iterable[tuple[str, Callable[[], Array]]]:
    """Geometrically exact beams, spring-dampers of constant force from hole to hole, and `mbs.SolveStatic`.

    With rotation vectors on a Lie group, which need a fourteenth of the time of Euler parameters here.
    """
    disks = len(case.robot.disks.positions)
    for elements in (1, 2) if disks else (8, 12, 16):
        for steps in (1, 2, 4, 8):

            def solve(elements: int = elements, steps: int = steps) -> Array:
                return _exudyn(case, elements, max(disks, 1), steps)

            yield f"{elements} elements per bay, {steps} load steps", solve


def _exudyn(case: Case, elements: int, bays: int, steps: int) -> Array:
    import exudyn as exu
    import exudyn.itemInterface as items

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    count, b = elements * bays, BACKBONE
    section = exu.BeamSection()
    area = np.pi * RADIUS**2
    section.massPerLength = 5600.0 * area
    section.inertia = 5600.0 * b.second_moment * np.diag([2.0, 1.0, 1.0])
    shear = b.shear_modulus * area
    section.stiffnessMatrix = np.diag([b.EA, shear, shear, b.GJ, b.EI, b.EI])
    # The axis of a beam is its x: turned to z.
    upright = [0.0, -np.pi / 2, 0.0]
    nodes = [
        mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0, 0, LENGTH * i / count, *upright]))
        for i in range(count + 1)
    ]
    for pair in pairwise(nodes):
        beam = items.ObjectBeamGeometricallyExact(
            nodeNumbers=list(pair), length=LENGTH / count, sectionData=section
        )
        mbs.AddObject(beam)
    ground = mbs.AddObject(items.ObjectGround())
    clamp = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
    first = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=nodes[0]))
    turned = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    mbs.AddObject(items.GenericJoint(markerNumbers=[clamp, first], rotationMarker0=turned))

    plates = [
        mbs.AddObject(items.ObjectRigidBody(physicsMass=1e-6, physicsInertia=[1e-9] * 3 + [0.0] * 3, nodeNumber=n))
        for n in nodes[::elements]
    ]  # fmt: skip

    def hole(disk: int, at: Array) -> int:
        place = [0.0, at[1], -at[0]]
        return mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=plates[disk], localPosition=place))

    connectors = []
    for tension, holes in case.tendons:
        markers = [hole(k, at) for k, at in enumerate(holes)]
        connectors += [
            (
                mbs.AddObject(items.SpringDamper(markerNumbers=list(pair), referenceLength=LENGTH / bays)),
                tension,
            )
            for pair in pairwise(markers)
        ]
    tip = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=nodes[-1]))
    load = mbs.AddLoad(items.Force(markerNumber=tip))
    mbs.Assemble()

    def ramp(mbs: Any, t: float) -> bool:
        for connector, tension in connectors:
            mbs.SetObjectParameter(connector, "force", tension * t)
        mbs.SetLoadParameter(load, "loadVector", list(case.force * t))
        return True

    mbs.SetPreStepUserFunction(ramp)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.numberOfLoadSteps = steps
    settings.staticSolver.loadStepGeometric = False
    settings.staticSolver.newton.relativeTolerance = 1e-6
    settings.staticSolver.newton.absoluteTolerance = 1e-7
    settings.staticSolver.newton.maxIterations = 100
    settings.staticSolver.verboseMode = 0
    mbs.SolveStatic(settings, showHints=False, autoAssemble=False)
    return np.array(mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Position))


# -------------------------------------------------------------------------------------------------------- MuJoCo


def mujoco_bodies(case: Case) -> Iterable[tuple[str, Callable[[], Array]]]:
    """Bodies on ball joints with springs, spatial tendons through sites; implicit steps until it rests.

    A ball joint is as stiff in torsion as in bending, which no case shows.
    """
    disks = max(len(case.robot.disks.positions), 1)
    for per_bay in (2, 4, 8, 10, 12) if disks > 1 else (20, 30, 40, 60):
        for step in (1e-2, 3e-2):
            for retardation in (3.0 * step, 10.0 * step):

                def solve(
                    per_bay: int = per_bay, step: float = step, retardation: float = retardation
                ) -> Array:
                    return _mujoco(case, per_bay, disks, step, retardation)

                yield (
                    f"{per_bay} bodies per bay, steps of {1e3 * step:g} ms, retardation {retardation:g} s",
                    solve,
                )


def _mujoco(case: Case, per_bay: int, bays: int, step: float, retardation: float) -> Array:
    import mujoco

    count = per_bay * bays
    h = LENGTH / count
    stiffness = BACKBONE.EI / h
    # Half a body at both ends: then joints with the bending of h lie at the middles of pieces of length h.
    sites: dict[int, list[str]] = {}
    paths = []
    for number, (_, holes) in enumerate(case.tendons):
        names = []
        for disk, at in enumerate(holes):
            names.append(f"s{number}_{disk}")
            sites.setdefault(disk * per_bay, []).append(
                f'<site name="{names[-1]}" pos="0 {at[1]:.12g} {-at[0]:.12g}"/>'
            )
        path = "".join(f'<site site="{name}"/>' for name in names)
        paths.append(f'<spatial name="t{number}">{path}</spatial>')
    # A body reaches from half a piece before its node to half a piece behind it.
    text = ""
    for node in range(count, 0, -1):
        own = "".join(sites.get(node, [])).replace('pos="0 ', f'pos="{h / 2:.12g} ')
        tip = f'<site name="tip" pos="{h / 2:.12g} 0 0"/>' if node == count else ""
        long = h if node < count else h / 2
        text = (
            f'<body name="b{node}" pos="{h if node > 1 else h / 2:.12g} 0 0">'
            f'<joint type="ball" stiffness="{stiffness:.12g}" damping="{retardation * stiffness:.12g}"/>'
            f'<geom type="capsule" size="{RADIUS!r}" fromto="0 0 0 {long:.12g} 0 0" mass="1e-4"/>'
            f"{own}{tip}{text}</body>"
        )
    base = "".join(sites.get(0, []))
    actuators = "".join(f'<motor tendon="t{k}" gear="-1"/>' for k in range(len(paths)))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{step:g}" gravity="0 0 0" integrator="implicitfast"/>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody><body quat="0.7071067811865476 0 -0.7071067811865476 0">{base}{text}</body></worldbody>
        <tendon>{"".join(paths)}</tendon><actuator>{actuators}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.ctrl[:] = [tension for tension, _ in case.tendons]
    body, site = model.body(f"b{count}").id, model.site("tip").id
    still, before = 0, np.zeros(3)
    for _ in range(int(20.0 / step)):
        data.xfrc_applied[body, :3] = case.force
        data.xfrc_applied[body, 3:] = np.cross(data.site_xpos[site] - data.xipos[body], case.force)
        mujoco.mj_step(model, data)
        moved = np.linalg.norm(data.site_xpos[site] - before)
        before = data.site_xpos[site].copy()
        still = still + 1 if moved < 1e-3 * NEAR * LENGTH else 0
        if still > 20:
            break
    return before


# ---------------------------------------------------------------------------------------------------- PyElastica


def pyelastica(case: Case) -> Iterable[tuple[str, Callable[[], Array]]]:
    """Position Verlet to rest, mass-proportional damping, a tenth of the axial and shear stiffness, large inertia.

    The step is as long as these allow; the true stiffnesses and inertia would take 170 times as many.
    """
    disks = max(len(case.robot.disks.positions), 1)
    for per_bay in (6, 8, 10) if disks > 1 else (15, 20):
        for periods in (1.0, 1.5):

            def solve(per_bay: int = per_bay, periods: float = periods) -> Array:
                return _pyelastica(case, per_bay, disks, periods)

            yield f"{per_bay} elements per bay, {periods:g} periods", solve


def _pyelastica(case: Case, per_bay: int, bays: int, periods: float) -> Array:
    import elastica as ea

    class Scene(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):  # type: ignore[misc]
        pass

    count, b, soft, density = per_bay * bays, BACKBONE, 0.1, 5600.0
    h = LENGTH / count
    # Plates, clamp and tip are in the middles of elements, where frames are: second order instead of first.
    rod = ea.CosseratRod.straight_rod(
        count + 1, np.array([0.0, 0.0, -h / 2]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), LENGTH + h,
        RADIUS, density, youngs_modulus=b.youngs_modulus, shear_modulus=b.shear_modulus,
    )  # fmt: skip
    for k, stiffness in enumerate((b.shear_modulus, b.shear_modulus, b.youngs_modulus)):
        rod.shear_matrix[k, k] = soft * stiffness * np.pi * RADIUS**2
    # The rotation of an element is then as slow as its stretching.
    inertia = (h / RADIUS) ** 2
    rod.mass_second_moment_of_inertia *= inertia
    rod.inv_mass_second_moment_of_inertia /= inertia
    wave = np.sqrt(b.youngs_modulus / density)
    step = 0.3 * h / (np.sqrt(soft) * wave)
    omega = 3.516 / LENGTH**2 * RADIUS / 2.0 * wave
    scene = Scene()
    scene.append(rod)
    scene.constrain(rod).using(
        ea.FixedConstraint, constrained_position_idx=(0, 1), constrained_director_idx=(0,)
    )
    scene.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=2.0 * omega, time_step=step)
    paths = [(tension, np.c_[holes, np.zeros(len(holes))], per_bay * np.arange(len(holes)))
             for tension, holes in case.tendons]  # fmt: skip
    tip_force = 0.5 * case.force[:, None]

    class Loads(ea.NoForces):  # type: ignore[misc]
        """Constant tensions from hole to hole, and the force at the tip; forces on elements go to their two nodes."""

        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            system.external_forces[:, -2:] += tip_force
            centres = 0.5 * (system.position_collection[:, 1:] + system.position_collection[:, :-1])
            for tension, holes, elements in paths:
                frames = system.director_collection[:, :, elements]
                levers = np.einsum("kin,nk->in", frames, holes)
                pieces = np.diff(centres[:, elements] + levers, axis=1)
                pull = tension * pieces / np.sqrt(np.einsum("in,in->n", pieces, pieces))
                force = np.zeros_like(levers)
                force[:, :-1] += pull
                force[:, 1:] -= pull
                system.external_forces[:, elements] += 0.5 * force
                system.external_forces[:, elements + 1] += 0.5 * force
                torque = np.cross(levers, force, axis=0)
                system.external_torques[:, elements] += np.einsum("kin,in->kn", frames, torque)

    scene.add_forcing_to(rod).using(Loads)
    scene.finalize()
    stepper = ea.PositionVerlet()
    total = periods * 2.0 * np.pi / omega
    ea.integrate(stepper, scene, final_time=total, n_steps=int(total / step), progress_bar=False)
    return np.asarray(rod.position_collection[:, -2:].mean(axis=1))


# ---------------------------------------------------------------------------------------------------------- table

CODES: dict[str, Callable[[Case], Iterable[tuple[str, Callable[[], Array]]]]] = {
    "this package": this_package,
    "Exudyn's own items": exudyn_items,
    "MuJoCo": mujoco_bodies,
    "PyElastica": pyelastica,
}


def fastest(case: Case, code: str, repeats: int) -> str:
    """Time and settings of the fastest discretisation that is near enough, as a cell of the table."""
    best, chosen = np.inf, ""
    for settings, solve in CODES[code](case):
        begun = time.process_time()
        try:
            tip = solve()
        except Exception as error:  # another code's failure is a result of this table
            print(f"    {code}, {settings}: {error!r:.200}", flush=True)
            continue
        spent = time.process_time() - begun
        off = float(np.linalg.norm(tip - case.tip)) / LENGTH
        print(f"    {code}, {settings}: {spent:.4f} s, off by {100 * off:.4f} %", flush=True)
        if off <= NEAR and spent < 2.0 * best:
            for _ in range(repeats if spent < 1.0 else 0):
                begun = time.process_time()
                solve()
                spent = min(spent, time.process_time() - begun)
            if spent < best:
                best, chosen = spent, settings
        if spent > LONGEST:
            break
    return f"{best:.3g} s ({chosen})" if chosen else "not near enough"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5, help="runs of the fastest settings [%(default)s]")
    repeats = parser.parse_args().repeats
    rows = []
    for case in cases():
        print(case.name, flush=True)
        rows.append([case.name, *(fastest(case, code, repeats) for code in CODES)])
    print("\n| case |", " | ".join(CODES), "|\n|", " --- |" * (len(CODES) + 1))
    for row in rows:
        print("|", " | ".join(row), "|")


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
