"""Interface of an effect, and the experiment that it acts on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, NamedTuple

from tdcr_fe.model.loading import Actuation, LoadStep, Model, resolve
from tdcr_fe.model.observed_step import Observation
from tdcr_fe.model.robot import Robot, Tendon

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
    ends : tuple of (int, float)
        For every one of ``steps``, the commanded step that it belongs to and the load factor at its end. Effects divide
        load steps in which an input has a kink; by default the steps are the commanded ones.
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
    ends: tuple[tuple[int, float], ...] = ()
    restarts: tuple[int, ...] = ()
    folder: int = 1
    folders: int = 1

    @property
    def folder_count(self) -> int:
        """How many folders of measured data there are, of all of which or of one of which this is."""
        return max(self.folders, len(self.restarts) + 1)

    def __post_init__(self) -> None:
        if len(self.ends) != len(self.steps):
            object.__setattr__(self, "ends", tuple((k, 1.0) for k in range(len(self.steps))))

    @property
    def whole_steps(self) -> list[int]:
        """Numbers of the steps, from 0, with which commanded ones end."""
        return [j for j, (_, factor) in enumerate(self.ends) if factor == 1.0]

    @property
    def first_steps(self) -> tuple[int, ...]:
        """Numbers of the steps, from 0, with which further loading sequences begin."""
        return tuple(self.whole_steps[k - 1] + 1 for k in self.restarts)

    @property
    def actions(self) -> list[Actuation]:
        """What acts at the end of every step."""
        return resolve(self.robot, self.steps, restarts=self.first_steps)

    @property
    def sequences(self) -> tuple[Experiment, ...]:
        """One experiment for each loading sequence that begins with the unloaded robot."""
        if not self.restarts:
            return (self,)
        bounds = (0, *self.restarts, self.ends[-1][0] + 1)
        sequences = []
        for number, (first, last) in enumerate(itertools.pairwise(bounds), 1):
            every = zip(self.steps, self.ends, strict=True)
            own = [(step, (k - first, factor)) for step, (k, factor) in every if first <= k < last]
            part = replace(self, folder=number, folders=self.folder_count, restarts=())
            sequences.append(replace(part, steps=tuple(s for s, _ in own), ends=tuple(e for _, e in own)))
        return tuple(sequences)

    def with_sequences(self, change: Callable[[Experiment], Experiment]) -> Experiment:
        """The experiment with every loading sequence changed by itself; robot, model and observation must agree."""
        if not self.restarts:
            return change(self)
        parts = [change(s) for s in self.sequences]
        firsts = zip((0, *self.restarts), parts, strict=True)
        ends = tuple((first + k, factor) for first, part in firsts for k, factor in part.ends)
        steps = tuple(step for part in parts for step in part.steps)
        whole = replace(parts[0], folder=self.folder, folders=self.folders, restarts=self.restarts)
        return replace(whole, steps=steps, ends=ends)

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

    def with_tendons(self, change: Callable[[Tendon], Tendon]) -> Experiment:
        """A copy with every tendon changed."""
        return self.with_robot(tendons=tuple(map(change, self.robot.tendons)))

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


def value_at(found: Any, path: Sequence[str]) -> Any:
    """The value at a path of fields, keys and indices."""
    for token in path:
        if is_dataclass(found):
            found = getattr(found, token)
        elif isinstance(found, Mapping):
            found = found[token]
        else:
            found = found[int(token)]
    return found


def with_value_at(found: Any, path: Sequence[str], value: Any) -> Any:
    """A copy with another value at a path."""
    if not path:
        return value
    token, rest = path[0], path[1:]
    if is_dataclass(found) and not isinstance(found, type):
        return replace(found, **{token: with_value_at(getattr(found, token), rest, value)})
    if isinstance(found, Mapping):
        return {**found, token: with_value_at(found[token], rest, value)}
    k = int(token)
    return (*found[:k], with_value_at(found[k], rest, value), *found[k + 1 :])


class Kind(NamedTuple):
    """What a cause perturbs, what that depends on, and where it acts; words as in `result.json`."""

    perturbs: str
    depends_on: tuple[str, ...]
    where: str = "everywhere"


#: What a form of an effect, or an effect at one place, has in common with it.
_COMMON = "description", "separating_experiment", "kind", "after", "exact_derivatives", "needs_friction"


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
        observation map. False: `identify` takes them as differences of two runs. It does the same where it finds none,
        as where a parameter changes the mesh.
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
    #: From how many of the same kind this one is chosen: at other places, or of other tendons or markers.
    among: int = 1
    #: Effects that may have to be there before data can show this one.
    after: tuple[str, ...] = ()
    #: Where its numbers stand in an experiment, which are then the null values: one, or one each.
    stands_at: tuple[str, ...] = ()
    #: Parameters beside `parameters`, which have their null values unless they are given.
    more: tuple[Parameter, ...] = ()
    #: How the names of `parts_of` look, as a regular expression; empty where there are none.
    part_names: str = ""

    def __init_subclass__(cls) -> None:
        """Take description and separating experiment from a docstring with these paragraphs, and name the kind."""
        if not cls.kind.perturbs:
            cls.kind = Kind(cls.name, ("nothing",))
        paragraphs = [" ".join(text.split()) for text in (cls.__doc__ or "").split("\n\n")]
        for number, text in enumerate(paragraphs):
            if text.startswith(DISTINGUISHED_BY):
                cls.description = " ".join(paragraphs[1:number])
                cls.separating_experiment = text.removeprefix(DISTINGUISHED_BY).removesuffix(".")

    def _like(self, listed: Effect) -> None:
        """Take from a listed effect what this one has in common with it."""
        for name in _COMMON:
            setattr(self, name, getattr(listed, name))

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

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """What a search tries along a whole robot: the effect itself, or with other numbers of parameters."""
        return () if self.needs_disks and experiment.robot.without_disks else (self,)

    def form(self, kind: str, names: Sequence[str], experiment: Experiment) -> Form:
        """The effect with other parameters, see `Form`."""
        return Form(self, kind, names, experiment)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """Values at which it changes nothing in ``experiment``."""
        if not self.stands_at:
            return {p.name: p.null_value for p in self.parameters}
        found = value_at(experiment, self.stands_at)
        numbers = zip(self.parameters, found if isinstance(found, tuple) else (found,), strict=True)
        return {p.name: math.inf if x is None else x for p, x in numbers}

    def parts_of(self, experiment: Experiment) -> dict[str, str]:
        """Parts of an experiment that may have numbers of their own, such as tendons: by name, what they are."""
        return {}

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """All parameters that may be given for an experiment, also those of single parts: ``NAME_PART``."""
        common = (*self.parameters, *self.more)
        return (*common, *for_each(common, self.parts_of(experiment)))

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
        if not self.stands_at:
            raise NotImplementedError
        numbers = tuple(None if math.isinf(x := values[p.name]) else x for p in self.parameters)
        return with_value_at(experiment, self.stands_at, numbers if len(numbers) > 1 else numbers[0])

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """Probe points near the null values, whose finite differences give the sensitivities.

        Returns
        -------
        list of list of dict
            Alternatives; each is a set of points, one for each direction from the null values.
        """
        null, steps = self.null_values(experiment), self.typical_steps(experiment, excitation)
        moved = [(p, p.coordinate(null[p.name]) + steps[p.name]) for p in self.parameters if p.name in steps]
        return [[{**null, p.name: p.value(x)} for p, x in moved]] if moved else []

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """By parameter, a change of its coordinate that these data show; without those that they cannot show."""
        return {p.name: p.scale for p in self.parameters}

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


def for_each(parameters: Sequence[Parameter], parts: Mapping[str, str]) -> tuple[Parameter, ...]:
    """Parameters for each of several parts, given by the end of the name and what is added to the meaning."""
    return tuple(
        replace(p, name=f"{p.name}_{end}", meaning=f"{p.meaning}: {part}")
        for end, part in parts.items()
        for p in parameters
    )


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
    """

    def __init__(self, of: Effect, kind: str, names: Sequence[str], experiment: Experiment) -> None:
        self.of, self.name = of, f"{of.name} ({kind})"
        self._like(of)
        known = {p.name: p for p in of.parameters_of(experiment)}
        self.parameters = tuple(known[n] for n in names)

    def one_of(self, count: int, where: str) -> Form:
        """The same as one of so many of its kind, which acts there: of single tendons or markers."""
        self.among, self.kind = count, self.kind._replace(where=where)
        return self

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
