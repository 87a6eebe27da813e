"""Interface of an effect, and the experiment that it acts on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.observed_step import Observation
from tdcr_fe.model.robot import Robot

Values = Mapping[str, float]
#: Alternatives; each is a set of points, one for each direction from the null values.
Points = list[list[dict[str, float]]]
#: Begins the paragraph of a class that says by which experiment its effect is distinguished from others.
DISTINGUISHED_BY = "Distinguished by: "
#: Lowest and highest value of every parameter.
Bounds = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Experiment:
    """Everything that an effect can act on: a robot, its model, its loading sequence, and the observation.

    Attributes
    ----------
    robot : Robot
    model : Model
    steps : tuple of LoadStep
        The commanded loading sequence; effects turn it into the actual one.
    observation : Observation
    ends : tuple of (int, float) or None
        Set where effects divide load steps because an input has a kink within the step: for every one of ``steps``, the
        commanded step that it belongs to and the load factor at its end. None: the steps are the commanded ones.
    restarts : tuple of int
        Commanded steps, from 0, at which the robot begins anew, unloaded: several loading sequences of one robot, each
        a folder of measured data.
    folder, folders : int
        Of several loading sequences, the number of this one, from 1, and how many there are.
    """

    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...] = ()
    observation: Observation = field(default_factory=Observation)
    ends: tuple[tuple[int, float], ...] | None = None
    restarts: tuple[int, ...] = ()
    folder: int = 1
    folders: int = 1

    @property
    def folder_count(self) -> int:
        """How many folders of measured data there are, of all of which or of one of which this is."""
        return max(self.folders, len(self.restarts) + 1)

    @property
    def step_ends(self) -> tuple[tuple[int, float], ...]:
        """For every step, the commanded step it belongs to and its load factor at the end."""
        return self.ends if self.ends is not None else tuple((k, 1.0) for k in range(len(self.steps)))

    @property
    def whole_steps(self) -> list[int]:
        """Numbers of the steps, from 0, with which commanded ones end."""
        return [j for j, (_, factor) in enumerate(self.step_ends) if factor == 1.0]

    @property
    def sequences(self) -> tuple[Experiment, ...]:
        """One experiment for each loading sequence that begins with the unloaded robot."""
        if not self.restarts:
            return (self,)
        ends = self.step_ends
        bounds = (0, *self.restarts, ends[-1][0] + 1)
        sequences = []
        for number, (first, last) in enumerate(itertools.pairwise(bounds), 1):
            chosen = [j for j, (k, _) in enumerate(ends) if first <= k < last]
            divided = None
            if self.ends is not None:
                divided = tuple((ends[j][0] - first, ends[j][1]) for j in chosen)
            part = replace(self, steps=tuple(self.steps[j] for j in chosen), ends=divided, restarts=())
            sequences.append(replace(part, folder=number, folders=self.folder_count))
        return tuple(sequences)

    def with_sequences(self, change: Callable[[Experiment], Experiment]) -> Experiment:
        """The experiment with every loading sequence changed by itself; robot, model and observation must agree."""
        if not self.restarts:
            return change(self)
        parts = [change(s) for s in self.sequences]
        ends: list[tuple[int, float]] = []
        for first, part in zip((0, *self.restarts), parts, strict=True):
            ends += [(first + k, factor) for k, factor in part.step_ends]
        divided = any(part.ends is not None for part in parts)
        steps = tuple(step for part in parts for step in part.steps)
        whole = replace(parts[0], folder=self.folder, folders=self.folders, restarts=self.restarts)
        return replace(whole, steps=steps, ends=tuple(ends) if divided else None)

    @property
    def largest_tension(self) -> float:
        """Largest tension commanded [N]; zero where all tendons are driven by displacement."""
        return max((t for step in self.steps for t in step.tensions.values()), default=0.0)

    def with_robot(self, **changes: Any) -> Experiment:
        """A copy with fields of the robot replaced."""
        return replace(self, robot=replace(self.robot, **changes))

    def with_backbone(self, **changes: Any) -> Experiment:
        """A copy with fields of the backbone replaced."""
        return self.with_robot(backbone=replace(self.robot.backbone, **changes))

    def with_friction(self) -> Experiment:
        """The same with friction switched on, where the declared model has none and can have it."""
        if self.model.friction == "none" and self.model.tendon_path == "straight":
            return replace(self, model=replace(self.model, friction="per-hole"))
        return self


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes
    ----------
    name, unit : str
    lower, upper : float
        Bounds.
    null_value : float
        Value at which the effect changes nothing; an effect may take it from the declared robot instead.
    scale : float
        Typical noticeable change of this number.
    meaning : str
    inverse : bool
        Fitted through its inverse, because its null value is infinite.
    """

    name: str
    unit: str
    lower: float
    upper: float
    null_value: float
    scale: float
    meaning: str
    inverse: bool = False

    def coordinate(self, value: float) -> float:
        """The number that is fitted."""
        return (0.0 if math.isinf(value) else 1.0 / value) if self.inverse else value

    def value(self, coordinate: float) -> float:
        """The parameter from the number that is fitted."""
        if self.inverse:
            return math.inf if coordinate <= 0.0 else 1.0 / coordinate
        return coordinate


@dataclass(frozen=True)
class ExcitationRange:
    """Range of the inputs and of the curvature in the data; sets the size of probe points.

    Attributes
    ----------
    tension : float
        Largest tension commanded or needed [N].
    displacement : float
        Largest displacement commanded [m].
    curvature : float
        Largest curvature that the declared model reaches [1/m].
    duration : float
        Time of the last step [s].
    """

    tension: float = 1.0
    displacement: float = 1e-3
    curvature: float = 1.0
    duration: float = 0.0


class Kind(NamedTuple):
    """What a cause perturbs, what that depends on, and where it acts; words as in `result.json`."""

    perturbs: str
    depends_on: tuple[str, ...]
    where: str = "everywhere"


class Effect:
    """A candidate that a model may be missing. Adding one takes a class and an entry of `tdcr_fe.effects.EFFECTS`.

    Attributes
    ----------
    name : str
        As in the table ``[effects]`` of ``scenario.toml``.
    description : str
        What it is, and where it comes from in a real robot.
    separating_experiment : str
        Experiment that separates it from effects with similar traces.
    kind : Kind
        Without one, an effect perturbs what its name says.
    parameters : tuple of Parameter
    exact_derivatives : bool
        Whether the derivatives by its parameters come out of the run (docs/sensitivities.md), or from the
        observation map. False: `identify` takes them as differences of two runs, and says so. It does the same where it
        finds none, as where a parameter changes the mesh.
    """

    name: str = ""
    description: str = ""
    separating_experiment: str = ""
    kind: Kind = Kind("", ("nothing",))
    parameters: tuple[Parameter, ...] = ()
    exact_derivatives: bool = True
    #: Whether it acts at disks or at the holes in them.
    needs_disks: bool = False
    #: Whether it acts through the friction of the tendons, and so cannot be in a model without.
    needs_friction: bool = False
    #: See `choices`.
    among: int = 1
    #: Effects that may have to be there before data can show this one.
    after: tuple[str, ...] = ()
    #: See `further_parameters`.
    further: ClassVar[Mapping[str, Parameter]] = {}

    def __init_subclass__(cls) -> None:
        """Take description and separating experiment from a docstring with these paragraphs, and name the kind."""
        if not cls.kind.perturbs:
            cls.kind = Kind(cls.name, ("nothing",))
        paragraphs = [" ".join(text.split()) for text in (cls.__doc__ or "").split("\n\n")]
        for number, text in enumerate(paragraphs):
            if text.startswith(DISTINGUISHED_BY):
                cls.description = " ".join(paragraphs[1:number])
                cls.separating_experiment = text.removeprefix(DISTINGUISHED_BY).removesuffix(".")

    @property
    def listed(self) -> str:
        """Name in the list of effects; another than `name` where this is a form of a listed one."""
        return self.name

    @property
    def law(self) -> str:
        """Name without tendon, place and rows."""
        return self.listed

    @property
    def is_of_reading(self) -> bool:
        """Whether it acts on the measurement only, so that the robot itself does not depend on it."""
        return self.kind.perturbs == "reading"

    def choices(self, robot: Robot) -> int:
        """From how many of the same kind this one is chosen: at other places, or of other tendons or markers."""
        return self.among

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """What a search tries along a whole robot: the effect itself, or with other numbers of parameters."""
        return () if self.needs_disks and experiment.robot.without_disks else (self,)

    def form(self, kind: str, names: Sequence[str], experiment: Experiment) -> Form:
        """The effect with other parameters, see `Form`."""
        return Form(self, kind, names, experiment)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """Values at which it changes nothing in ``experiment``."""
        return {p.name: p.null_value for p in self.parameters}

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """All parameters that may be given for an experiment, such as one for each tendon."""
        return self.parameters

    @property
    def further_parameters(self) -> Mapping[str, Parameter]:
        """Parameters besides `parameters` whose names depend on the experiment, by regular expression of the name."""
        return self.further

    def null_value(self, experiment: Experiment, name: str) -> float:
        """Value at which one parameter of `parameters_of` changes nothing."""
        null = {p.name: p.null_value for p in self.parameters_of(experiment)} | self.null_values(experiment)
        return null.get(name, self.parameters[0].null_value)

    def unidentifiable_at_null(self, experiment: Experiment) -> tuple[str, ...]:
        """Parameters that change nothing while the others have their null values; `probe_points` has alternatives."""
        return ()

    def near_null(self, experiment: Experiment) -> Effect:
        """An effect that has the same derivatives at the null values; one that leaves the mesh as it is.

        `identify` screens all candidates in one run, which has one mesh.
        """
        return self

    def bounds(self, experiment: Experiment) -> Bounds:
        """Bounds of every parameter for this robot."""
        return {p.name: (p.lower, p.upper) for p in self.parameters}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """The experiment with the effect; all parameters are given."""
        raise NotImplementedError

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """Probe points near the null values, whose finite differences give the sensitivities.

        Returns
        -------
        list of list of dict
            Alternatives; each is a set of points, one for each direction from the null values.
        """
        null = self.null_values(experiment)
        return [[{**null, p.name: null[p.name] + p.scale} for p in self.parameters]]

    def alone(self, values: Values, experiment: Experiment) -> dict[str, float]:
        """Values that do to one folder of measured data alone what these do to it among several."""
        return dict(values)

    def check(self, values: Values, experiment: Experiment) -> None:
        """Refuse unknown and impossible values in an experiment.

        Raises
        ------
        ValueError
        """
        known = {p.name: p for p in self.parameters_of(experiment)}
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise ValueError(f"effect {self.name}: no parameter {unknown[0]!r}; it has {', '.join(known)}")
        if self.needs_disks and experiment.robot.without_disks:
            text = "the robot has no disks and no holes in them; massless [disks] are guides"
            raise ValueError(f"effect {self.name}: {text}")
        for name, value in values.items():
            p = known[name]
            if math.isnan(value) or not p.lower <= value <= p.upper:
                text = f"must be from {p.lower:g} to {p.upper:g} {p.unit}"
                raise ValueError(f"effect {self.name}: {name} = {value:g}; {text}")


class Form(Effect):
    """A listed effect with other parameters: some of `Effect.parameters_of`.

    Parameters
    ----------
    of
        The listed effect.
    kind
        Behind its name, in brackets.
    names
        Names of the parameters.
    experiment
        Whose tendons or markers they belong to.
    among
        See `Effect.choices`.
    """

    def __init__(
        self, of: Effect, kind: str, names: Sequence[str], experiment: Experiment, among: int = 1
    ) -> None:
        self.of, self.name, self.among = of, f"{of.name} ({kind})", among
        self.description, self.separating_experiment = of.description, of.separating_experiment
        for name in ("kind", "after", "exact_derivatives", "needs_friction"):
            setattr(self, name, getattr(of, name))
        known = {p.name: p for p in of.parameters_of(experiment)}
        self.parameters = tuple(known[n] for n in names)

    @property
    def listed(self) -> str:
        """See `Effect.listed`."""
        return self.of.name

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """Null values of the listed effect."""
        return {p.name: self.of.null_value(experiment, p.name) for p in self.parameters}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """Apply the listed effect."""
        return self.of.apply(experiment, values)
