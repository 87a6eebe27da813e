"""Tendons of the reference: the paper's equations, friction and its history."""

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone, StiffnessPatch, Superelastic
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.newton import natural_residual, solve_box

L = 0.25
BACKBONE = Backbone(L, 0.4e-3, 85e9, 0.3, density=5600.0)


def robot(routing=None, disks=13, mu=0.0, **tendon):
    routing = routing or ParallelRouting(4.5e-3, 0.0)
    return Robot(
        BACKBONE,
        Disks.equally_spaced(disks, L, mass=0.17e-3),
        (Tendon("t", routing, friction_coefficient=mu, **tendon),),
    )


def run(robot, steps, path="straight", friction="none", gravity=(0.0, 0.0, 0.0), settings=None):
    result = solve_reference(robot, Model(path, friction, gravity=gravity), steps, settings=settings)
    assert result.converged, result.message
    return result


def pulls(*values, name="t", **rest):
    return [LoadStep(tensions={name: v}, **rest) for v in values]


SIDE = {"tip": Load(L, (0.05, 0.0, 0.0))}


@pytest.mark.parametrize(("tension", "angle"), [(0.5, 19.02837), (1.0, 38.39846), (2.5, 98.5664)])
def test_planar_integration_of_the_papers_robot(tension, angle):
    step = run(robot(), pulls(tension)).steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(angle, abs=6e-5)


def test_friction_of_the_papers_robot():
    step = run(robot(mu=0.3), pulls(2.5), friction="per-hole").steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(80.2627, abs=1e-4)
    assert step.tensions[0][-1] == pytest.approx(1.69753, abs=1e-5)
    assert step.hole_states[0] == ("pull",) * 12 + ("anchor",)


@pytest.mark.parametrize("routing", [HelicalRouting(4.5e-3, 1.0), ConvergingRouting(4e-3, 1e-3, 30.0)])
def test_equation_9_of_the_paper_holds_pointwise(routing):
    """Rod wrench from the strain of the solved shape; its derivative balances the coupled tendon forces."""
    tension, h, at = 2.0, 2e-4, 0.11
    s = at + h * np.arange(-4, 5)
    settings = ReferenceSettings(sample_at=tuple(s), max_step=0.01)
    step = run(robot(routing), pulls(tension, loads=SIDE), "continuous", settings=settings).steps[0]
    index = [int(np.argmin(np.abs(step.s - x))) for x in s]
    p, r = step.positions[index], step.rotations[index]
    first = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)

    def derivative(values):
        return np.array([np.tensordot(first, values[i - 2 : i + 3], 1) for i in range(2, len(values) - 2)])

    slope, turn, r, p = derivative(p), derivative(r), r[2:-2], p[2:-2]
    skew = np.swapaxes(r, 1, 2) @ turn
    curvature = np.stack((skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]), axis=1)
    stretch = np.einsum("nji,nj->ni", r, slope)
    moment = curvature * [BACKBONE.EI, BACKBONE.EI, BACKBONE.GJ]
    force = (stretch - [0.0, 0.0, 1.0]) * [BACKBONE.GA, BACKBONE.GA, BACKBONE.EA]
    world_moment, world_force = (np.einsum("nij,nj->ni", r, x) for x in (moment, force))
    hole = np.concatenate((routing.position(s[2:-2], L), np.zeros((5, 1))), axis=1)
    arm = np.einsum("nij,nj->ni", r, hole)
    line = p + arm
    d1 = np.tensordot(first, line, 1)
    d2 = np.tensordot(np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12.0 * h**2), line, 1)
    per_length = -tension * np.cross(d1, np.cross(d1, d2)) / np.linalg.norm(d1) ** 3
    np.testing.assert_allclose(np.tensordot(first, world_force, 1), -per_length, atol=2e-4)
    twist = np.tensordot(first, world_moment, 1) + np.cross(slope[2], world_force[2])
    np.testing.assert_allclose(twist, -np.cross(arm[2], per_length), atol=2e-6)


def test_continuous_model_refuses_friction():
    with pytest.raises(ValueError, match="has no friction"):
        solve_reference(robot(), Model("continuous", "per-hole"), pulls(1.0))


CYCLE = (1.0, 2.5, 1.5, 0.2, 0.0, 1.0, 2.5)
ROUTINGS = {
    "parallel": ParallelRouting(4.5e-3, 40.0),
    "helical": HelicalRouting(4.5e-3, 2.0),
    "converging": ConvergingRouting(4.5e-3, 0.15e-3, 10.0),
    "points": PointsRouting(tuple(L * np.arange(14) / 13), tuple((4e-3, 2e-4 * i) for i in range(14))),
}


def angles_at_holes(step, model):
    tendon = model.tendons[0]
    holes = np.concatenate((model.holes(tendon), np.zeros((len(step.s), 1))), axis=1)
    points = step.positions + np.einsum("nij,nj->ni", step.rotations, holes)
    t = np.diff(points, axis=0)
    t /= np.linalg.norm(t, axis=1)[:, None]
    return np.arctan2(np.linalg.norm(np.cross(t[:-1], t[1:]), axis=1), np.sum(t[:-1] * t[1:], axis=1))


@pytest.mark.integration
@pytest.mark.parametrize(
    ("name", "friction"), [("parallel", "per-hole"), ("helical", "per-hole"), ("converging", "per-tendon")]
)
def test_ratios_lie_within_the_capstan_bounds_and_on_them_where_it_slips(name, friction):
    model = robot(ROUTINGS[name], mu=0.3)
    for step in run(model, pulls(*CYCLE, loads=SIDE), friction=friction, gravity=(0.0, -9.81, 0.0)).steps:
        tension, states = step.tensions[0], step.hole_states[0]
        if tension[0] < 1e-9:
            assert np.all(tension < 1e-9)
            continue
        ratio = np.log(tension[1:] / tension[:-1])
        bound = 0.3 * angles_at_holes(step, model)
        assert np.all(np.abs(ratio) <= bound + 1e-9)
        sign = np.array([{"pull": -1.0, "release": 1.0, "stick": np.nan}[w] for w in states[:-1]])
        slips = np.isfinite(sign)
        np.testing.assert_allclose(ratio[slips], (sign * bound)[slips], atol=1e-8)


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
def test_no_friction_coefficient_is_no_friction_to_the_last_bit(friction):
    steps = pulls(*CYCLE, loads=SIDE)
    one, other = run(robot(), steps, friction=friction), run(robot(mu=0.3), steps, friction="none")
    np.testing.assert_array_equal(one.tips, other.tips)
    assert set(one.steps[-1].hole_states[0]) == {"stick", "anchor"}


@pytest.mark.integration
def test_monotone_loading_is_the_same_per_tendon_and_per_hole():
    steps = pulls(0.5, 1.0, 2.0, 3.0)
    one, other = (run(robot(mu=0.3), steps, friction=f) for f in ("per-tendon", "per-hole"))
    np.testing.assert_allclose(one.tips, other.tips, atol=1e-10)


@pytest.mark.integration
@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_turning_robot_and_loads_about_z_turns_the_answer(path):
    friction = "none" if path == "continuous" else "per-hole"
    tips = []
    for angle in (0.0, 77.0):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        load = {"mid": Load(0.11, tuple(turn @ [0.02, 0.1, 0.05]), tuple(turn @ [1e-3, 0.0, 2e-3]))}
        turned = robot(HelicalRouting(4.5e-3, 1.5, angle), mu=0.3)
        turned = turned.with_backbone(precurvature=tuple((turn @ [1.0, 0.5, 0.0])[:2]))
        result = run(turned, pulls(2.0, 1.0, loads=load), path, friction, tuple(turn @ [3.0, -9.0, 1.0]))
        tips.append(result.tips @ turn)
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-11)


def test_a_displacement_gives_back_the_tension_that_caused_it():
    for path in ("straight", "continuous"):
        for stiffness in (None, 400.0):
            model = robot(HelicalRouting(4.5e-3, 1.0), axial_stiffness=stiffness)
            pulled = run(model, pulls(2.0), path).steps[0]
            step = LoadStep(displacements={"t": float(pulled.displacements[0])})
            driven = run(model, [step], path).steps[0]
            assert driven.base_tensions[0] == pytest.approx(2.0, rel=1e-6)
            np.testing.assert_allclose(driven.tip, pulled.tip, atol=1e-9)


def test_an_elastic_tendon_adds_its_stretch_to_the_displacement():
    model = robot(axial_stiffness=400.0)
    elastic, rigid = run(model, pulls(1.5)).steps[0], run(robot(), pulls(1.5)).steps[0]
    np.testing.assert_allclose(elastic.tip, rigid.tip, atol=1e-12)
    path = L - rigid.displacements[0]
    extra = path - path / (1.0 + 1.5 / 400.0)
    assert elastic.displacements[0] - rigid.displacements[0] == pytest.approx(extra, rel=1e-9)


def test_a_tendon_let_out_is_slack():
    step = run(robot(), [LoadStep(displacements={"t": -1e-3}, loads=SIDE)]).steps[0]
    assert np.all(step.tensions[0] == 0.0)
    bare = run(Robot(BACKBONE, Disks.equally_spaced(13, L)), [LoadStep(loads=SIDE)]).steps[0]
    np.testing.assert_allclose(step.tip, bare.tip, atol=1e-9)


def test_adhesion_takes_a_drop_at_every_hole_down_to_zero():
    step = run(robot(adhesion=0.2), pulls(1.5), friction="per-hole").steps[0]
    np.testing.assert_allclose(step.tensions[0][:8], 1.5 - 0.2 * np.arange(8), atol=1e-9)
    # where nothing pulls any more, the last holes stick within the presliding distance
    assert np.all(step.tensions[0][8:] < 0.01)
    assert set(step.hole_states[0][7:]) == {"stick", "anchor"}


@pytest.mark.integration
def test_more_disks_approach_the_continuous_model():
    routing = HelicalRouting(4.5e-3, 1.0)
    exact = run(robot(routing), pulls(1.5), "continuous").steps[0].tip
    counts = np.array([10, 20, 40])
    errors = [np.linalg.norm(run(robot(routing, int(n)), pulls(1.5)).steps[0].tip - exact) for n in counts]
    assert np.all(np.diff(np.log(errors)) / np.log(2.0) < -0.8)


@pytest.mark.integration
def test_large_bending_helix_and_convergence_need_no_initial_guess():
    assert run(robot(disks=13), pulls(4.5)).steps[0].bending_angle > 2.5
    angle = [s.bending_angle for s in run(robot(disks=20), pulls(2.0, 4.0, 4.7), "continuous").steps]
    assert np.degrees(angle[-1]) == pytest.approx(4.7 / 2.0 * np.degrees(angle[0]), rel=1e-9)
    run(robot(HelicalRouting(4.5e-3, 2.0), 5), pulls(6.0))
    run(robot(ConvergingRouting(4.5e-3, 0.15e-3), 5), pulls(6.0))


@pytest.mark.integration
def test_stuck_antagonists_converge():
    tendons = tuple(
        Tendon(str(i), ParallelRouting(4.5e-3, 90.0 * i), friction_coefficient=0.3) for i in range(4)
    )
    model = Robot(BACKBONE, Disks.equally_spaced(13, L), tendons)
    draw = np.random.default_rng(1)
    steps = [LoadStep(tensions={t.name: float(draw.uniform(0.0, 3.0)) for t in tendons}) for _ in range(10)]
    result = run(model, steps, friction="per-hole", settings=ReferenceSettings(substeps=1))
    states = {word for step in result.steps for one in step.hole_states for word in one}
    assert states == {"stick", "pull", "release", "anchor"}
    finer = run(model, steps, friction="per-hole", settings=ReferenceSettings(presliding=1e-7, substeps=1))
    np.testing.assert_allclose(result.tips, finer.tips, atol=2e-4)


@pytest.mark.integration
def test_every_feature_of_the_description_together():
    model = Robot(
        BACKBONE,
        Disks.equally_spaced(9, L, mass=0.17e-3, thickness=3e-3),
        robot(mu=0.2, end=L).tendons,
        tip_mass=1e-3,
    ).with_backbone(
        superelastic=Superelastic(0.002, 0.2),
        precurvature=(0.5, -1.0),
        patches=(StiffnessPatch(0.1, 0.13, 0.6, 0.8),),
    )
    model = model.with_tendons(axial_stiffness=500.0, adhesion=0.01)
    loads = {"mid": Load(0.077, (0.0, 0.1, 0.0)), "tip": Load(L, (0.0, 0.0, 0.02), frame="section")}
    result = run(model, pulls(0.5, 1.0, 0.3, loads=loads), friction="per-hole", gravity=(0.0, -9.81, 0.0))
    continuous = run(model, pulls(0.5, 1.0, 0.3, loads=loads), "continuous", gravity=(0.0, -9.81, 0.0))
    assert np.linalg.norm(result.tips[1] - continuous.tips[1]) < 0.03 * L


def test_a_failing_step_is_named_with_a_cure(monkeypatch):
    monkeypatch.setattr("tdcr_fe.validation.reference.newton.MAX_ITERATIONS", 1)
    monkeypatch.setattr("tdcr_fe.validation.reference.path.MAX_BISECTIONS", 0)
    result = solve_reference(robot(), Model("straight", "none"), pulls(0.0, 2.5))
    assert not result.converged
    assert result.failed_step == 2
    assert len(result.steps) == 1
    assert "smaller load steps" in result.message


def test_box_problems_with_positive_minors_are_solved():
    draw = np.random.default_rng(3)
    for _ in range(50):
        n = 12
        root = draw.normal(size=(n, n))
        skew = draw.normal(size=(n, n))
        matrix = root @ root.T + 0.01 * np.eye(n) + skew - skew.T
        offset = 5.0 * draw.normal(size=n)
        lower, upper = -np.ones(n), np.where(np.arange(n) < 6, 1.0, np.inf)
        v = solve_box(matrix, offset, np.zeros(n), lower, upper)
        np.testing.assert_allclose(natural_residual(matrix @ v + offset, v, lower, upper), 0.0, atol=1e-8)
