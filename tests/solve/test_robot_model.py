"""The forces of a stack of models, whose differences are derivatives, are those that Exudyn evaluates."""

from __future__ import annotations

import numpy as np
import pytest
from robots import three

from tdcr_fe.effects import Experiment
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.model.backbone import StiffnessPatch, Superelastic
from tdcr_fe.model.friction import ForceDependentFriction, StribeckFriction
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.sensitivities.robot_model import ModelStack, RobotModel, RobotPoint
from tdcr_fe.solve.simulation import Simulation

STEPS = [
    LoadStep(
        "", {"t1": 1.2, "t2": 0.4}, loads={"tip": Load(0.25, (0.02, 0.05, 0.0), (0.0, 1e-3, 2e-3))}, time=1.0
    ),
    LoadStep(
        "",
        {"t1": 0.9, "t2": 0.7},
        loads={"mid": Load(0.1, (0.0, 0.1, 0.0), (1e-3, 0.0, 1e-3), "section")},
        time=3.0,
    ),
]

ROBOTS = {
    "friction": (three(0.3), {"gravity": (1.0, 2.0, -9.81)}),
    "thick disks, precurved, patch": (
        three(0.2)
        .with_disks(thickness=2e-3)
        .with_backbone(precurvature=(0.5, -0.3), patches=(StiffnessPatch(0.1, 0.13, 0.5, 0.7),)),
        {"gravity": (0.0, 5.0, -9.81)},
    ),
    "elastic, adhesion, clearance": (
        three(0.2).with_tendons(axial_stiffness=500.0, adhesion=0.01, clearance=3e-4),
        {},
    ),
    "superelastic, creep": (
        three(0.2).with_backbone(superelastic=Superelastic(4e-4, 0.3), creep_rate=0.05),
        {},
    ),
    "continuous, superelastic": (
        three(0.0).with_backbone(superelastic=Superelastic(4e-4, 0.3)),
        {"friction": "none", "tendon_path": "continuous"},
    ),
    "Stribeck": (three(0.0).with_tendons(friction=StribeckFriction(0.3, 0.2, 1e-3)), {}),
    "force-dependent": (three(0.0).with_tendons(friction=ForceDependentFriction(0.3, 0.1)), {}),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_wrenches_on_the_nodes_are_those_of_exudyn(name: str) -> None:
    """In a solved state and in a configuration that is far from equilibrium, to 1e-8 of the largest wrench."""
    robot, options = ROBOTS[name]
    robot = Robot(robot.backbone, robot.disks, robot.tendons, robot.name, robot.tip_mass)
    model = Model(**{"friction": "per-hole", "elements_per_bay": 1, **options})
    actions = resolve(robot, STEPS)
    simulation = Simulation(robot, model, actions)
    for action in actions:
        simulation.advance(action)
    system, state = simulation.system, simulation.state
    stack = ModelStack([RobotModel.of(Experiment(robot, model, tuple(STEPS)), 1e-6)] * 2)
    mesh = simulation.handle.mesh
    rng = np.random.default_rng(1)
    for change in (0.0, 0.02):
        unknowns = state.configuration.unknowns
        twists = unknowns.twists[0] + change * rng.normal(size=unknowns.twists[0].shape) * np.array(
            [1e-6, 1e-6, 1e-6, 1.0, 1.0, 1.0]
        )
        moved = state._replace(
            configuration=system.layout.space.build(unknowns._replace(twists=(twists,))),
            mobilisation=(np.clip(state.mobilisation[0] * 0.7, -1.0, 1.0),),
        )
        target = Target(state.inputs, state.loads, state.time)
        found = system.residual(moved, target, system.numbering())
        expected = found.unbalanced.reshape(-1, 6).copy()
        expected[0] = found.on_bases[0]
        rotations = moved.configuration.poses[0][1]
        point = RobotPoint(
            *moved.configuration.poses[0], twists, moved.base_tension[0], moved.mobilisation[0]
        )
        rate = found.forces[0].field.slip_rate
        rates = np.zeros_like(point.mobilisation) if rate is None else rate
        ours = stack.at(point, np.stack([rates] * 2), np.full(2, moved.time)).wrenches[1].copy()
        for key, load in zip(simulation.loads, state.loads, strict=True):
            node = mesh.node_at(key[1], 1e-6)
            turn = BEAM_TO_SECTION if key[2] == "section" else rotations[node]
            ours[node] += (load.reshape(2, 3) @ turn).ravel()
        # Strains of stiff elements have the round-off of the poses, from which Exudyn computes them.
        rounding = 1e-14 * mesh.stiffness.max(axis=0) / mesh.lengths.min()
        # The base also carries the reaction of its joint.
        difference = np.abs(ours - expected)[1:]
        assert difference[:, :3].max() < 1e-8 * max(np.abs(expected[1:, :3]).max(), 1.0) + rounding[:3].max()
        assert difference[:, 3:].max() < 1e-8 * max(np.abs(expected[1:, 3:]).max(), 1e-3) + rounding[3:].max()
