"""Blind data: made by the reference alone, answers kept apart, repeatable; scoring; and causes beyond the list."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, effect, read_measured
from tdcr_fe.effects import EFFECTS, Experiment, Observation
from tdcr_fe.effects.base import Kind
from tdcr_fe.validation.blind.declared import draw_robot
from tdcr_fe.validation.blind.hidden import DETECTABLE, DRAW, RANGES
from tdcr_fe.validation.blind.maker import make_blind
from tdcr_fe.validation.blind.readings import read
from tdcr_fe.validation.blind.recipes import LATER, PLANNED_PLACES, ROBOTS, SOFT, Recipe, plan
from tdcr_fe.validation.blind.scoring import score
from tdcr_fe.validation.blind.unlisted import LEAST_OFF, MOST_OFF, RECIPES, make_unlisted
from tdcr_fe.validation.campaigns.blind import calibration
from tdcr_fe.validation.campaigns.unlisted import judge
from tdcr_fe.validation.reference import Extras, ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.settings import PointForce


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One small set with precurvature: data as read, and the answer."""
    folder = tmp_path_factory.mktemp("blind") / "set"
    answer = make_blind(folder, Recipe(7, "single", ("precurvature",)), substeps=1)
    return folder, read_measured(folder), answer


def test_a_plan_covers_everything_early_and_does_not_depend_on_its_length():
    recipes = plan(60, 3)
    assert recipes[:28] == plan(28, 3)
    assert len({r.seed for r in recipes}) == 60
    first = {r.effects[0] for r in recipes[:28] if r.kind == "single"}
    assert first == {e.name for e in EFFECTS} - set(LATER)
    kinds = [r.kind for r in recipes]
    assert kinds.count("clean") >= 8 and kinds.count("pair") >= 6 and kinds.count("weak") >= 2
    assert {r.effects[0] for r in recipes if r.kind == "place"} == set(PLANNED_PLACES)
    assert {r.robot for r in recipes} == set(ROBOTS)
    assert all(5e-5 <= r.sigma <= 5e-4 for r in recipes)


def test_the_folder_has_the_declared_robot_and_not_the_answer(made):
    folder, data, answer = made
    files = {"robot.toml", "model.toml", "loading.csv", "observations.csv"}
    assert {p.name for p in folder.iterdir()} == files
    assert data.robot.backbone.precurvature == (0.0, 0.0)
    assert answer.effects["precurvature"]["kappa_x"] != 0.0
    assert answer.declared_off >= DETECTABLE
    hidden = [f"{v:g}"[:6] for v in answer.effects["precurvature"].values()]
    for path in folder.glob("*.toml"):
        assert not [h for h in hidden if h in path.read_text("utf-8")]


def test_noise_has_the_size_that_is_declared(made):
    _, data, answer = made
    z = [(r.value - x) / r.sigma for r, x in zip(data.readings, answer.noise_free, strict=True)]
    assert np.std(z) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(z)))
    assert abs(np.mean(z)) < 4.0 / np.sqrt(len(z))


def test_the_same_recipe_makes_the_same_set(made, tmp_path):
    folder, _, answer = made
    assert make_blind(tmp_path, answer.recipe, substeps=1) == answer
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()


def test_a_turned_frame_and_markers_beside_the_backbone_are_read_as_declared():
    """A quarter turn about z of an unbent robot whose markers sit 2 mm along x: they are seen 2 mm along y."""
    robot = draw_robot("single", np.random.default_rng(1))
    steps = (LoadStep(tensions={"t1": 0.0}),)
    look = Observation(rotation=(0.0, 0.0, np.pi / 2.0), offset=(2e-3, 0.0, 0.0))
    result = solve_reference(robot, Model(), steps, settings=ReferenceSettings())
    length = robot.backbone.length
    marks = [(0, f"position_{a}", length) for a in "xyz"]
    marks += [(0, "bending_angle", None), (0, "distal_tension", "t1")]
    seen = read(result, Experiment(robot, Model(), steps, look), marks)
    np.testing.assert_allclose(seen, (0.0, 2e-3, length, 0.0, 0.0), atol=1e-12)


# ---------------------------------------------------------------------------------------------- marking


def outcome(made, verdict="explained", named=(("precurvature", ()),), off=1.0, answer=None, at=None):
    """Score of a synthetic result whose parameters are off by so many standard errors, but for those given."""
    _, data, hidden = made
    answer = answer or hidden
    noise = np.array([r.value - x for r, x in zip(data.readings, answer.noise_free, strict=True)])
    effects = []
    for n, rivals in named:
        values = {p: v + off * 0.01 for p, v in answer.effects.get(n, {}).items()} | (at or {})
        estimates = {p: SimpleNamespace(value=v, std_error=0.01) for p, v in values.items()}
        about = {"probability": 0.97, "indistinguishable_from": rivals, "parameters": estimates}
        effects.append(SimpleNamespace(name=n, found=True, **about))
    residuals, remaining = SimpleNamespace(before=3.0 * noise, after=noise), SimpleNamespace(where="nowhere")
    found = {"data": data, "verdict": verdict, "effects": effects, "held_out_steps": (1, 2, 3)}
    return score(answer, SimpleNamespace(**found, residuals=residuals, remaining=remaining))


def test_names_are_right_among_those_named_together_or_wrong(made):
    assert outcome(made).outcome == "right"
    assert outcome(made, named=(("gravity", ("precurvature",)),)).outcome == "named together"
    assert outcome(made, named=(("gravity", ()),)).outcome == "wrong"
    assert outcome(made, named=(("precurvature", ()), ("gravity", ()))).outcome == "wrong"
    assert outcome(made, "nothing missing", named=()).outcome == "wrong"


def test_calibration_counts_how_often_a_claim_holds(made):
    """One standard error is outside of the 50 % interval, inside of the others; two are inside of that of 95 %."""
    right, wrong = outcome(made), outcome(made, named=(("gravity", ()),), off=0.0)
    far, none = outcome(made, off=1.9), replace(right, deviations={}, probabilities={"precurvature": 0.6})
    table = calibration([right, far, wrong, none]).set_index("claim")["holds in"].tolist()
    assert table == ["0 of 4", "2 of 4", "4 of 4", "0 of 0", "1 of 1", "0 of 0", "2 of 3"]


def test_an_effect_at_its_place_is_right_by_kind_bay_and_tendon(made):
    _, data, answer = made
    edges = data.robot.bay_edges
    middles = (0.5 * (edges[1:] + edges[:-1])).tolist()

    def marked(name, at, hidden, verdict="explained"):
        secret = replace(answer, recipe=replace(answer.recipe, effects=tuple(hidden)), effects=hidden)
        return outcome(made, verdict, ((name, ()),) if name else (), answer=secret, at=at).outcome

    kink = {"kink": {"s": middles[3], "kappa_x": 2.0}}
    assert marked("kink", {"s": middles[3] + 1e-3}, kink) == "right"
    assert marked("kink", {"s": middles[4]}, kink) == "overconfident"
    assert marked("soft_bay", {"s": middles[3]}, kink) == "overconfident"
    assert marked("", {}, kink, "unexplained") == "honest"
    stuck = {"stuck_hole": {"tendon": 2.0, "s": edges[3], "drop": 1.0}}
    assert marked("stuck_hole", {"tendon": 2.0, "s": edges[3]}, stuck) == "right"
    assert marked("stuck_hole", {"tendon": 1.0, "s": edges[3]}, stuck) == "overconfident"


def test_every_listed_effect_has_random_values():
    """An effect added to the list must get an entry in one of both tables."""
    assert set(DRAW) | set(RANGES) | set(SOFT) == {e.name for e in EFFECTS}


# ------------------------------------------------------------ causes beyond the list


LENGTH = 0.2
ROBOT = Robot(Backbone(LENGTH, 0.5e-3, 60e9, 0.3, 6000.0), Disks.equally_spaced(4, LENGTH), ())
EI = ROBOT.backbone.EI
MODEL = Model(friction="none")


@pytest.mark.parametrize("share", [0.3, 2.0, -0.15])
def test_a_moment_bends_a_hardening_rod_to_the_arc_of_its_law(share):
    """EI kappa + c kappa^2 = M along the whole rod: an arc, whose curvature solves the quadratic equation."""
    moment = 4.0 * EI
    c = share * EI / 4.0
    law = Extras(bending=lambda b: c * np.linalg.norm(b.strain[:, :2], axis=1)[:, None] * b.strain[:, :2])
    steps = [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, moment, 0.0))})]
    result = solve_reference(ROBOT, MODEL, steps, settings=ReferenceSettings(substeps=4), extras=law)
    kappa = (-EI + np.sqrt(EI**2 + 4.0 * c * moment)) / (2.0 * c)
    angle = kappa * LENGTH
    tip = np.array([(1.0 - np.cos(angle)) / kappa, 0.0, np.sin(angle) / kappa])
    np.testing.assert_allclose(result.steps[0].tip, tip, atol=2e-7 * LENGTH)
    assert abs(angle - moment * LENGTH / EI) > 0.05


def test_a_force_that_depends_on_the_displacement_balances_the_load():
    """A cubic spring at the tip of a rod that hardly bends: u L^3-compliance and spring in series."""
    stiffness = 3.0 * EI / LENGTH**3
    u = 1e-3 * LENGTH
    cubic = 0.1 * stiffness / u**2
    spring = PointForce(LENGTH, lambda d: np.array([-cubic * d[0] ** 3, 0.0, 0.0]))
    steps = [LoadStep(loads={"tip": Load(LENGTH, (stiffness * u + cubic * u**3, 0.0, 0.0))})]
    settings = ReferenceSettings(substeps=4)
    result = solve_reference(ROBOT, MODEL, steps, settings=settings, extras=Extras(forces=(spring,)))
    assert result.steps[0].tip[0] == pytest.approx(u, rel=1e-4)  # shear and shortening: below 1e-4


@pytest.mark.integration
@pytest.mark.parametrize("name", ["hardening", "drift of the camera"])
def test_a_blind_set_differs_from_the_declared_robot_above_the_noise(name):
    made = make_unlisted(next(r for r in RECIPES if r.name == name), 9000)
    assert LEAST_OFF <= made.declared_off <= MOST_OFF
    noise = [(r.value - x) / r.sigma for r, x in zip(made.data.readings, made.exact, strict=True)]
    assert np.std(noise) == pytest.approx(1.0, abs=0.1)
    assert made.data.steps[-1].time is None


def judged(name, *kinds, effects=()):
    """The outcome of a set where causes of these kinds and these effects were found."""
    causes = [("", Kind(perturbs, tuple(depends_on))) for perturbs, *depends_on in kinds]
    causes += [(e, effect(e).kind) for e in effects]
    misfit = SimpleNamespace(rms_position=1e-3)
    errors = SimpleNamespace(held_out=misfit)
    result = SimpleNamespace(
        verdict="explained by a law found", before=errors, after=errors, noise=misfit,
        effects=[SimpleNamespace(name=n, found=bool(n), kind=kind, kind_probability=1.0) for n, kind in causes],
    )  # fmt: skip
    return judge(next(r for r in RECIPES if r.name == name), result, 1.0)


def test_a_set_passes_with_its_kind_and_dependence_alone_and_no_name():
    right = ("stiffness", "curvature")
    assert judged("hardening", right).passed
    assert not judged("hardening", right, effects=("superelastic",)).passed
    assert not judged("hardening", right, ("precurvature", "time")).right
    assert not judged("hardening", ("stiffness", "curvature", "place")).right
    assert not judged("hardening", ("moment", "curvature")).right
    assert not judged("hardening").right
