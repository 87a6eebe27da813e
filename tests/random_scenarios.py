"""Random robots and scenarios over all options at once, for tests that go through the commands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.backbone import Backbone, StiffnessPatch
from tdcr_fe.model.disks import Disks
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.material import Superelastic
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting, Routing
from tdcr_fe.model.tendon import Tendon

#: Effects that a scenario may ask for, with values for the robots drawn here.
EFFECTS: dict[str, dict[str, float]] = {
    "gravity": {"g_x": 3.0, "g_z": -9.0},
    "tip_payload": {"mass": 2e-4},
    "stiffness_scale": {"bending": 0.9, "torsion": 1.2},
    "precurvature": {"kappa_x": 0.5},
    "rigid_disks": {"thickness": 1e-3},
    "friction_coefficient": {"mu": 0.2},
    "hole_adhesion": {"drop": 2e-3},
    "routing_twist": {"angle_tip": 0.4},
    "hole_clearance": {"clearance": 1e-4},
    "tendon_stretch": {"axial_stiffness": 500.0},
    "superelastic": {"threshold_strain": 0.01, "plateau_ratio": 0.4},
    "actuator_gain": {"gain": 0.95},
    "actuator_loss": {"dead_band": 0.02, "efficiency": 0.95},
    "actuator_backlash": {"backlash": 2e-4},
    "creep": {"rate": 0.01},
}


@dataclass(frozen=True)
class RandomScenario:
    """A robot with its loading sequence.

    Attributes
    ----------
    seed : int
    robot, model, steps
        The description without the effects.
    effects : dict
        By name, values of their parameters; empty for no table ``[effects]``.
    """

    seed: int
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    effects: dict[str, dict[str, float]]

    def write(self, folder: Path) -> Path:
        """Write both files; returns the path of the scenario."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "robot.toml").write_text(robot_to_toml(self.robot), encoding="utf-8")
        path = folder / "scenario.toml"
        text = scenario_to_toml(self.model, self.steps, effects=self.effects or None)
        path.write_text(text, encoding="utf-8")
        return path


def _routing(rng: np.random.Generator, arc: np.ndarray, angle: float) -> Routing:
    offset = float(rng.uniform(2.5e-3, 4.5e-3))
    kind = rng.integers(0, 6)
    if kind == 3:
        return HelicalRouting(offset, float(rng.uniform(-1.5, 1.5)), angle)
    if kind == 4:
        return ConvergingRouting(offset, float(rng.uniform(0.1, 1.0)) * offset, angle)
    if kind == 5:
        a = np.deg2rad(angle) + 0.1 * rng.standard_normal(len(arc)).cumsum() / np.sqrt(len(arc))
        holes = np.column_stack((offset * np.cos(a), offset * np.sin(a)))
        return PointsRouting(tuple(arc.tolist()), tuple((float(x), float(y)) for x, y in holes))
    return ParallelRouting(offset, angle)


def _backbone(rng: np.random.Generator, length: float, continuous: bool) -> Backbone:
    radius = float(rng.uniform(0.3e-3, 0.5e-3))
    rest: dict[str, object] = {}
    if rng.random() < 0.2:
        rest["precurvature"] = tuple(rng.uniform(-2.0, 2.0, 2).tolist())
    if rng.random() < 0.2:
        rest["superelastic"] = Superelastic(float(rng.uniform(0.002, 0.01)), float(rng.uniform(0.2, 0.8)))
    if rng.random() < 0.15:
        start = float(rng.uniform(0.0, 0.5)) * length
        rest["patches"] = (StiffnessPatch(start, start + 0.3 * length, 0.8, 1.1),)
    return Backbone(length, radius, float(rng.uniform(50e9, 90e9)), 0.3, 5600.0, **rest)  # type: ignore[arg-type]


def _disks(rng: np.random.Generator, length: float) -> Disks:
    count = int(
        rng.choice([1, 2, 3, 5, 8, 10, 13, 20, 40], p=[0.06, 0.06, 0.1, 0.2, 0.2, 0.14, 0.14, 0.07, 0.03])
    )
    thickness = 0.0 if rng.random() < 0.7 else min(2e-3, 0.3 * length / count)
    mass = float(rng.choice([0.0, 1.7e-4]))
    if rng.random() < 0.8:
        return Disks.equally_spaced(count, length, mass=mass, thickness=thickness)
    gaps = rng.uniform(0.6, 1.4, count + 1)
    positions = length * gaps.cumsum()[:-1] / gaps.sum()
    return Disks(tuple(float(x) for x in positions), mass=mass, thickness=thickness)


def _steps(rng: np.random.Generator, robot: Robot, by_displacement: bool) -> tuple[LoadStep, ...]:
    length, stiffness = robot.backbone.length, robot.backbone.EI
    names = robot.tendon_names
    steps = []
    for number in range(int(rng.integers(1, 4))):
        tensions, displacements, loads = {}, {}, {}
        angle = float(rng.uniform(0.0, 1.2))
        pulled = names[int(rng.integers(len(names)))] if names else ""
        for name in names:
            if by_displacement:
                # Only tendons that share the pull are driven; the rest stay slack.
                displacements[name] = 3e-3 * angle if name == pulled else -6e-3
            elif name == pulled:
                tensions[name] = angle * stiffness / length / 4e-3
            elif rng.random() < 0.3:
                tensions[name] = 0.2 * angle * stiffness / length / 4e-3
        if rng.random() < 0.5:
            at = length if rng.random() < 0.6 else float(rng.uniform(0.2, 0.95)) * length
            force = 0.4 * stiffness / length**2 * rng.standard_normal(3)
            moment = 0.2 * stiffness / length * rng.standard_normal(3) if rng.random() < 0.3 else np.zeros(3)
            frame = str(rng.choice(["world", "section"]))
            loads["load"] = Load(at, tuple(force.tolist()), tuple(moment.tolist()), frame)  # type: ignore[arg-type]
        label = "" if rng.random() < 0.3 else f"step {number + 1}"
        substeps = None if rng.random() < 0.85 else int(rng.integers(1, 4))
        steps.append(
            LoadStep(label, tensions, displacements, loads, substeps=substeps, time=60.0 * (number + 1))
        )
    return tuple(steps)


def draw(seed: int) -> RandomScenario:
    """The scenario of a seed."""
    rng = np.random.default_rng([4711, seed])
    length = float(rng.uniform(0.1, 0.3))
    continuous = bool(rng.random() < 0.35)
    disks = _disks(rng, length)
    tendons = []
    for i in range(int(rng.choice([0, 1, 2, 3, 4, 6], p=[0.03, 0.22, 0.15, 0.35, 0.15, 0.1]))):
        last = len(disks.positions) - 1 if rng.random() < 0.6 else int(rng.integers(len(disks.positions)))
        end = disks.positions[last]
        at_tip = abs(end - length) < 1e-9
        arc = np.array([0.0, *disks.positions[: last + 1]])
        tendons.append(
            Tendon(
                f"t{i + 1}",
                _routing(rng, arc, float(rng.uniform(0.0, 360.0))),
                friction_coefficient=float(rng.choice([0.0, 0.1, 0.3])),
                end=None if at_tip else end,
                axial_stiffness=None if rng.random() < 0.7 else float(rng.uniform(300.0, 3000.0)),
                adhesion=0.0 if continuous or rng.random() < 0.85 else 3e-3,
                clearance=0.0 if continuous or rng.random() < 0.85 else 1e-4,
            )
        )
    robot = Robot(
        _backbone(rng, length, continuous),
        disks,
        tuple(tendons),
        tip_mass=0.0 if rng.random() < 0.8 else 2e-4,
    )
    friction = "none" if continuous else str(rng.choice(["none", "per-tendon", "per-hole"]))
    mesh = "auto" if rng.random() < 0.8 else int(rng.integers(1, 5))
    gravity = (0.0, 0.0, 0.0) if rng.random() < 0.5 else tuple((5.0 * rng.standard_normal(3)).tolist())
    model = Model("continuous" if continuous else "straight", friction, mesh, gravity)  # type: ignore[arg-type]
    by_displacement = bool(tendons) and rng.random() < 0.3
    effects: dict[str, dict[str, float]] = {}
    if rng.random() < 0.3:
        allowed = [n for n in EFFECTS if tendons or n in ("gravity", "tip_payload", "stiffness_scale")]
        straight = ("hole_clearance", "hole_adhesion", "friction_coefficient", "rigid_disks")
        allowed = [n for n in allowed if not (continuous and n in straight)]
        name = str(rng.choice(allowed))
        effects[name] = EFFECTS[name]
    return RandomScenario(seed, robot, model, _steps(rng, robot, by_displacement), effects)
