"""Tangent of robots alone: against Exudyn's Jacobian and connectors; its banded form."""

from dataclasses import replace
from typing import Any

import exudyn.itemInterface as eii
import numpy as np
import pytest
from robots import LENGTH, paper, pull, seven, tendon
from scenes import scene

from tdcr_fe import Disks, Robot, Simulation
from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.solve.equations import band
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.equations.kernel import StaticKernel
from tdcr_fe.solve.equations.system import SceneSystem


@pytest.mark.parametrize("per_bay", [1, 3])
def test_forces_and_tangent_of_tendons_are_those_of_exudyns_connectors(per_bay):
    """Spring-dampers that carry the tensions, against the matrix products; bent and twisted, far from equilibrium."""
    _keep, mbs, _ = scene(seven(0.0), friction="none", elements_per_bay=per_bay)
    system = SceneSystem(mbs)
    start, tensions = system.current_state(), np.array([2.0, 0.7, 0.4])
    unknowns = start.configuration.unknowns
    change = 0.1 * np.random.default_rng(3).normal(size=unknowns.twists[0].shape)
    twists = unknowns.twists[0] + change * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]
    bent = system.layout.space.build(unknowns._replace(twists=(twists,)))
    state = start._replace(configuration=bent, base_tension=(tensions,))
    residual = system.residual(state, Target((tensions,)), system.numbering())
    k = system.tangent(residual)
    frames = residual.state.configuration.frames
    robot = system.robots[0]
    assert not robot.connected
    for springs, carried in zip(robot.connectors.springs, residual.forces[0].field.tension, strict=True):
        for spring, tension in zip(springs, carried, strict=False):
            mbs.SetObjectParameter(spring, "force", float(tension))
            mbs.SetObjectParameter(spring, "activeConnector", True)
    wrenches = system.layout.reduction.residual(StaticKernel(mbs, system.hooks).residual(), frames)
    assert residual.unbalanced[6:] == pytest.approx(wrenches[6:], abs=1e-9 * np.abs(wrenches).max())
    exudyns = system.layout.reduction.tangent(StaticKernel(mbs, system.hooks).jacobian(), frames)
    residual.forces[0].add_coupling(exudyns)
    assert k == pytest.approx(exudyns, abs=1e-8 * np.abs(exudyns).max())


def test_other_objects_and_changed_stiffness_bring_exudyns_jacobian_back():
    """The elements' stiffness is the tangent only where nothing else resists, and where the beams have it."""
    _keep, mbs, handle = scene(paper())
    assert SceneSystem(mbs).layout.only_robots_resist(())
    section = mbs.GetObjectParameter(handle.oBeams[2], "sectionData")
    section.stiffnessMatrix = 1.5 * np.array(section.stiffnessMatrix)
    mbs.SetObjectParameter(handle.oBeams[2], "sectionData", section)
    assert not SceneSystem(mbs).layout.only_robots_resist(())

    _keep, mbs, handle = scene(paper(), assemble=False)
    ground = mbs.AddObject(eii.ObjectGround())
    above = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localPosition=[0.0, 0.0, 0.3]))
    mbs.AddObject(eii.SpringDamper(markerNumbers=[handle.mTip, above], stiffness=10.0, referenceLength=0.05))
    mbs.Assemble()
    assert not SceneSystem(mbs).layout.only_robots_resist(())


# ------------------------------------------------------------ band


def short_and_long() -> Robot:
    """Three tendons of different ends, one elastic, one with adhesion."""
    others = tendon("t2", 120.0, 0.2, axial_stiffness=2000.0), tendon("t3", 250.0, 0.1, adhesion=0.02)
    return replace(paper(), tendons=(tendon("t1", 0.0, 0.3, end=paper().disks.positions[6]), *others))


def free_end() -> Robot:
    """One tendon that ends at the last disk, a fifth of the length before the tip."""
    disks = Disks.equally_spaced(13, 0.8 * LENGTH)
    return replace(paper(), disks=disks, tendons=(tendon("t1", 0.0, 0.3, end=float(disks.positions[-1])),))


CASES: dict[str, tuple[Robot, dict[str, Any], LoadStep]] = {
    "one tendon": (paper(0.3), {}, pull(2.0)[0]),
    "no friction": (paper(), {"friction": "none"}, pull(2.0)[0]),
    "one sign per tendon": (paper(0.3), {"friction": "per-tendon"}, pull(2.0)[0]),
    "two elements a bay": (paper(0.3), {"elements_per_bay": 2}, pull(2.0)[0]),
    "different ends": (short_and_long(), {}, LoadStep("", {"t1": 1.0, "t2": 0.6, "t3": 0.9})),
    "displacements": (seven(0.3), {}, LoadStep("", displacements={"t1": 2e-3, "t2": -1e-3, "t3": -1.2e-3})),
    "free end": (free_end(), {}, pull(2.0)[0]),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_same_with_the_band_and_without(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions of all nodes at the end of three steps, and the iterations but for a last one near round-off."""
    robot, model, step = CASES[case]
    steps = []
    for share in (0.5, 1.0, 0.8):
        inputs = [{n: share * x for n, x in given.items()} for given in (step.tensions, step.displacements)]
        steps.append(LoadStep("", *inputs))
    found = []
    for widest in (1.0, 0.0):
        monkeypatch.setattr(band, "WIDEST", widest)
        targets = resolve(robot, steps)
        simulation = Simulation(robot, Model(**{"elements_per_bay": 1, **model}), targets)
        assert (simulation.system.layout.bands == (None,)) == (widest == 0.0)
        iterations = [simulation.advance(t).iterations_total for t in targets]
        found.append((iterations, simulation.state.configuration.positions))
    assert max(abs(a - b) for a, b in zip(found[0][0], found[1][0], strict=True)) <= 1
    # One iteration more or less makes this difference: the residual has a tolerance of 1e-8.
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-9 * LENGTH)
