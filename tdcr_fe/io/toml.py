"""Input files: `robot.toml`, `scenario.toml` and `model.toml` to the frozen description and back.

Every mistake in the files is found in one pass and named with file, key, value and what is allowed.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictInt, ValidationError

from tdcr_fe.model.checks import (
    Contradiction,
    backbone_contradictions,
    disk_contradictions,
    hole_count_contradiction,
    name_contradictions,
    tendon_contradictions,
)
from tdcr_fe.model.loading import Friction, Load, LoadStep, Model, TendonPath
from tdcr_fe.model.robot import ARC_TOLERANCE, Backbone, Disks, Robot, Tendon
from tdcr_fe.model.routing import ROUTINGS, PointsRouting, Routing

# ------------------------------------------------------------------------------------------- what is wrong


@dataclass(frozen=True)
class Problem:
    """One mistake in the input.

    Attributes
    ----------
    file : str
        As the user named it.
    key : str
        Dotted path in the file, such as ``tendons[0].offset``; empty where the whole file is meant.
    value : str
        What was found there, as text; empty where nothing was.
    allowed : str
        What is allowed there.
    """

    file: str
    key: str
    value: str
    allowed: str

    def __str__(self) -> str:
        """One line: file, key, value, what is allowed."""
        where = f"{self.file}: {self.key}" if self.key else self.file
        return f"{where} = {self.value}: {self.allowed}" if self.value else f"{where}: {self.allowed}"


class InputError(Exception):
    """The input is wrong.

    Attributes
    ----------
    problems : tuple of Problem
        Every mistake found, at least one.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(p) for p in self.problems))


@dataclass(frozen=True)
class Scenario:
    """What a `scenario.toml` and the `robot.toml` that it names say.

    Attributes
    ----------
    robot : Robot
    model : Model
    steps : tuple of LoadStep
    path : pathlib.Path
        Of the scenario.
    robot_path : pathlib.Path
    digests : mapping of str to str
        SHA-256 of both files, in hexadecimal, by file name as the user named it.
    """

    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    path: Path
    robot_path: Path
    digests: Mapping[str, str] = field(default_factory=dict)


# --------------------------------------------------------------------------------- what the tables may hold


def _named(text: str) -> str:
    if not text.strip() or text != text.strip() or not text.isprintable():
        raise ValueError("a name")
    return text


def _number(allowed: str, default: Any = ..., **bounds: Any) -> Any:
    return Field(default, description=allowed, allow_inf_nan=False, **bounds)


Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0.0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0.0)]
Triple = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Pair = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Name = Annotated[str, AfterValidator(_named)]
AnyTable = dict[str, Any]

_NAME = "a name in quotes: not empty, printable, no blanks at its ends"


class _Table(BaseModel):
    """A flat table; each field's description says what is allowed."""

    model_config = ConfigDict(extra="forbid", strict=True)


class _RobotFile(_Table):
    name: Name = Field("robot", description=_NAME)
    backbone: AnyTable = Field(
        description="a table [backbone] with length, radius, youngs_modulus, poisson_ratio"
    )
    disks: AnyTable = Field(description="a table [disks] with count or positions")
    tendons: list[Any] = Field([], description="tables [[tendons]], one a tendon")


class _BackboneTable(_Table):
    length: float = _number("a positive number [m], at most 1000", gt=0.0, le=1000.0)
    radius: float = _number("a positive number [m]", gt=0.0)
    youngs_modulus: float = _number("a positive number [Pa]", gt=0.0)
    poisson_ratio: float = _number("a number above -1, up to 0.5", gt=-1.0, le=0.5)
    density: float = _number("a number, zero or more [kg/m^3]", 0.0, ge=0.0)
    bending_stiffness: float | None = _number("a positive number [N m^2]", None, gt=0.0)
    torsional_stiffness: float | None = _number("a positive number [N m^2]", None, gt=0.0)
    axial_stiffness: float | None = _number("a positive number [N]", None, gt=0.0)
    shear_stiffness: float | None = _number("a positive number [N]", None, gt=0.0)


class _DisksTable(_Table):
    count: StrictInt | None = Field(None, ge=1, le=10_000, description="a whole number from 1 to 10000")
    positions: Annotated[list[Positive], Field(min_length=1)] | None = Field(
        None, description="arc lengths of the disks [m], ascending from above 0 to at most the length"
    )
    mass: float = _number("a number, zero or more [kg], of each disk", 0.0, ge=0.0)
    thickness: float = _number("a number, zero or more [m]", 0.0, ge=0.0)
    radius: float = _number("a positive number [m], at most 1000", 5e-3, gt=0.0, le=1000.0)


_TURNS = {"ge": -1000.0, "le": 1000.0}
_OFFSET = "a number, zero or more [m], not outside the disk"


class _TendonTable(_Table):
    name: Name = Field(description=_NAME)
    routing: str = Field(description="one of " + ", ".join(f'"{r}"' for r in ROUTINGS))
    friction_coefficient: float = _number("a number, zero or more", 0.0, ge=0.0)
    end: float | None = _number("a positive number [m], where a disk is", None, gt=0.0)
    axial_stiffness: float | None = _number("a positive number [N]", None, gt=0.0)


class _ParallelTendon(_TendonTable):
    offset: float = _number(_OFFSET, ge=0.0)
    angle_deg: float = _number("a number [deg], from +x towards +y", 0.0)


class _HelicalTendon(_ParallelTendon):
    turns: float = _number(
        "a number, turns from base to end, at most 1000, negative for left-handed", **_TURNS
    )


class _ConvergingTendon(_ParallelTendon):
    end_offset: float = _number(_OFFSET, ge=0.0)


class _PointsTendon(_TendonTable):
    holes: list[Pair] = Field(
        description="pairs [x, y] in m, one a hole: base plate first, then every disk up to the end"
    )


class _UnknownTendon(_TendonTable):
    offset: float | None = _number(_OFFSET, None, ge=0.0)
    angle_deg: float | None = _number("a number [deg]", None)
    turns: float | None = _number("a number", None)
    end_offset: float | None = _number(_OFFSET, None, ge=0.0)
    holes: list[Pair] | None = Field(None, description="pairs [x, y] in m")


_TENDON_TABLES: dict[str, type[_TendonTable]] = {
    "parallel": _ParallelTendon,
    "helical": _HelicalTendon,
    "converging": _ConvergingTendon,
    "points": _PointsTendon,
}


class _ModelFile(_Table):
    model: AnyTable = Field(description="a table [model]; it may be empty")


class _ScenarioFile(_Table):
    robot: str = Field(description="the path of a robot.toml, in quotes, relative to this file")
    model: AnyTable = Field({}, description="a table [model]")
    steps: list[Any] = Field(min_length=1, description="tables [[steps]], at least one")


class _ModelTable(_Table):
    tendon_path: TendonPath = Field("straight", description='"straight" or "continuous"')
    friction: Friction = Field("per-hole", description='"none", "per-tendon" or "per-hole"')
    elements_per_bay: Annotated[int, Field(ge=1, le=64)] | Literal["auto"] = Field(
        "auto", description='"auto" or a whole number from 1 to 64'
    )
    gravity: Triple = Field(
        [0.0, 0.0, 0.0], description="three finite numbers [m/s^2], such as [0.0, 0.0, -9.81]"
    )


class _StepTable(_Table):
    label: str = Field("", description="a text in quotes")
    tensions: dict[str, NotNegative] = Field({}, description="a number in N, zero or more, by tendon name")
    displacements: dict[str, Finite] = Field({}, description="a finite number in m, by tendon name")
    loads: AnyTable = Field({}, description="a table of loads by name, each with at, force, moment, frame")
    substeps: StrictInt | None = Field(None, ge=1, le=100_000, description="a whole number from 1 to 100000")
    time: float | None = _number("a number, zero or more [s]", None, ge=0.0)


class _LoadTable(_Table):
    at: float = _number("an arc length [m], from 0 to the length of the backbone", ge=0.0)
    force: Triple = Field([0.0, 0.0, 0.0], description="three finite numbers [N], such as [0.0, 0.05, 0.0]")
    moment: Triple = Field([0.0, 0.0, 0.0], description="three finite numbers [N m]")
    frame: Literal["world", "section"] = Field("world", description='"world" or "section"')


# ---------------------------------------------------------------------------- one table, mistakes collected

#: Takes key, value and what is allowed of one mistake.
Report = Callable[[str, str, str], None]

Steps = tuple[LoadStep, ...]

#: Tables of `scenario.toml` beyond those here: by name, a function from the table, the robot, the model, the
#: steps and a `Report` to another robot, model and steps.
EXTRA_TABLES: dict[str, Callable[[Any, Robot, Model, Steps, Report], tuple[Robot, Model, Steps]]] = {}


def _text(value: Any, limit: int = 60) -> str:
    """A value as it stands in a TOML file, its middle left out where it is long."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(f"{_key(k)} = {_text(v)}" for k, v in value.items()) + "}"
    elif isinstance(value, list):
        text = "[" + ", ".join(_text(v) for v in value) + "]"
    else:
        try:
            text = str(value)
        except ValueError:
            text = "a number of thousands of digits"
    return text if len(text) <= limit else text[: limit - 10] + " ... " + text[-5:]


def _key(name: str) -> str:
    """A bare key, or a quoted one where TOML asks for it."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _path(key: str, *parts: str | int) -> str:
    for part in parts:
        key += f"[{part}]" if isinstance(part, int) else f".{_key(part)}" if key else _key(part)
    return key


def _meant(given: Any, options: Iterable[str]) -> str:
    """A question that names the option most like what was given, or nothing."""
    near = difflib.get_close_matches(str(given), list(options), n=1, cutoff=0.6)
    return f"; did you mean {near[0]}?" if near else ""


def _check(
    table: type[_Table], data: Any, key: str, report: Report, extra: Iterable[str] = ()
) -> tuple[dict[str, Any], set[str]]:
    """The sound values of a table, defaults filled in, and the fields that are not sound."""
    fields = table.model_fields
    if not isinstance(data, dict):
        report(key, _text(data), "must be a table with " + ", ".join(fields))
        return {}, set(fields)
    known = {k: v for k, v in data.items() if k not in set(extra)}
    bad: set[str] = set()
    try:
        table.model_validate(known)
    except ValidationError as error:
        seen: set[str] = set()
        for e in error.errors(include_url=False):
            name = str(e["loc"][0])
            value: Any = known
            shown: list[str | int] = []
            for part in e["loc"]:
                try:
                    value = value[part]
                except (KeyError, IndexError, TypeError):
                    break  # pydantic's own names of the alternatives in a union
                shown.append(part)
            if e["type"] == "extra_forbidden":
                allowed = [*fields, *extra]
                sentence = f"unknown key{_meant(name, allowed)}; allowed here: {', '.join(allowed)}"
                report(_path(key, name), _text(value), sentence)
                continue
            bad.add(name)
            described = fields[name].description or ""
            if e["type"] == "missing":
                report(_path(key, name), "", f"missing; must be {described}")
                continue
            where = _path(key, *shown)
            if where in seen:
                continue
            seen.add(where)
            options = re.findall(r'"([^"]+)"', described) if isinstance(value, str) else []
            report(where, _text(value), f"must be {described}{_meant(value, options)}")
    sound = {
        name: known.get(name, f.default)
        for name, f in fields.items()
        if name not in bad and (name in known or not f.is_required())
    }
    return sound, bad


def _floats(values: Mapping[str, Any]) -> dict[str, Any]:
    """Whole numbers as floating-point ones."""
    return {k: float(v) if isinstance(v, int) and not isinstance(v, bool) else v for k, v in values.items()}


# ----------------------------------------------------------------------------------------------- the robot


@dataclass
class _RobotParts:
    """What of a robot is sound: enough to check a scenario against it."""

    robot: Robot | None = None
    length: float | None = None
    names: tuple[str, ...] | None = None


def _build_robot(data: dict[str, Any], report: Report) -> _RobotParts:
    parts = _RobotParts()
    count = 0

    def note(key: str, value: str, allowed: str) -> None:
        nonlocal count
        count += 1
        report(key, value, allowed)

    def note_all(found: Iterable[Contradiction]) -> None:
        for c in found:
            note(*c)

    top, bad = _check(_RobotFile, data, "", note)
    backbone = length = None
    if "backbone" in top:
        values, wrong = _check(_BackboneTable, top["backbone"], "backbone", note)
        length = float(values["length"]) if "length" in values else None
        if not wrong:
            backbone = Backbone(**_floats(values))
            note_all(backbone_contradictions(backbone))
    parts.length = length

    disks, radius = _build_disks(top["disks"], length, note) if "disks" in top else (None, None)

    tables = top.get("tendons", [])
    tendons: list[Tendon] = []
    names: list[str] = []
    for i, table in enumerate(tables):
        tendon, name = _build_tendon(i, table, disks, radius, length, note)
        if tendon is not None:
            tendons.append(tendon)
        if name is not None:
            names.append(name)
    note_all(name_contradictions(names))
    if "tendons" not in bad and len(set(names)) == len(tables):
        parts.names = tuple(names)

    if count == 0 and backbone is not None and disks is not None:
        try:
            parts.robot = Robot(backbone, disks, tuple(tendons), name=top["name"])
        except ValueError as error:  # a check that only the whole robot knows
            note("", "", str(error))
    return parts


def _build_disks(data: Any, length: float | None, note: Report) -> tuple[Disks | None, float | None]:
    """The disks, None where their places are not sound; and their radius, None where that is not sound."""
    values, bad = _check(_DisksTable, data, "disks", note)
    radius = float(values["radius"]) if "radius" in values else None
    if not isinstance(data, dict):
        return None, radius
    if ("count" in data) == ("positions" in data):
        both = "count" in data
        note(
            "disks.count" if both else "disks",
            _text(data["count"]) if both else "",
            "count and positions are both given; exactly one is allowed"
            if both
            else "missing; exactly one of count and positions must be given",
        )
        return None, radius
    if bad & {"count", "positions"} or length is None:
        return None, radius
    if values.get("count") is not None:
        positions = Disks.equally_spaced(values["count"], length).positions
    else:
        positions = tuple(float(x) for x in values["positions"])
    disks = Disks(
        positions,
        mass=float(values.get("mass", 0.0)),
        thickness=float(values.get("thickness", 0.0)),
        radius=float("inf") if radius is None else radius,
    )
    found = disk_contradictions(disks, length)
    for c in found:
        if values.get("count") is not None and c.key.startswith("disks.positions"):
            c = Contradiction(
                "disks.count", str(values["count"]), "too many; they must be apart from each other"
            )
        note(*c)
    return (None if any("positions" in c.key for c in found) else disks), radius


def _build_tendon(
    i: int, data: Any, disks: Disks | None, radius: float | None, length: float | None, note: Report
) -> tuple[Tendon | None, str | None]:
    """A tendon, None where it is not sound; and its name, None where that is not sound."""
    key = f"tendons[{i}]"
    kind = data.get("routing") if isinstance(data, dict) else None
    table = _TENDON_TABLES.get(kind, _UnknownTendon) if isinstance(kind, str) else _UnknownTendon

    def explain(where: str, value: str, allowed: str) -> None:
        name = where.rpartition(".")[2]
        if allowed.startswith("unknown key") and name in _UnknownTendon.model_fields:
            owners = [k for k, t in _TENDON_TABLES.items() if name in t.model_fields]
            allowed = f"only for routing = {' or '.join(map(_quoted, owners))}; " + allowed.partition("; ")[2]
        note(where, value, allowed)

    values, bad = _check(table, data, key, explain)
    name = values.get("name")
    if isinstance(kind, str) and kind not in _TENDON_TABLES:
        described = _TendonTable.model_fields["routing"].description
        note(f"{key}.routing", _text(kind), f"must be {described}{_meant(kind, _TENDON_TABLES)}")
    if (
        table is _UnknownTendon
        or bad - {"name", "friction_coefficient", "axial_stiffness"}
        or disks is None
        or length is None
    ):
        for field_name in ("offset", "end_offset"):  # all that can be said without the rest
            offset = values.get(field_name)
            if offset is not None and radius is not None and offset > radius:
                note(
                    f"{key}.{field_name}",
                    _text(offset),
                    f"must not lie outside the disk of radius {radius:g} m",
                )
        return None, name
    values = _floats(values)
    tendon = Tendon(
        name=name or "?",
        routing=_routing(values, disks, length),
        friction_coefficient=values.get("friction_coefficient", 0.0),
        end=values["end"],
        axial_stiffness=values.get("axial_stiffness"),
    )
    found = tendon_contradictions(i, tendon, disks, length)
    if kind == "points" and not any(c.key.endswith(".end") for c in found):
        needed = 1 + int(sum(x <= (tendon.end or length) + ARC_TOLERANCE for x in disks.positions))
        if len(values["holes"]) != needed:
            found = [hole_count_contradiction(i, len(values["holes"]), needed)]
    for c in found:
        note(*c)
    return (None if bad or found else tendon), name


def _routing(values: Mapping[str, Any], disks: Disks, length: float) -> Routing:
    """The routing that sound values of a tendon's table describe."""
    kind = values["routing"]
    if kind == "points":
        holes = tuple((float(x), float(y)) for x, y in values["holes"])
        end = length if values["end"] is None else values["end"]
        arcs = (0.0, *(s for s in disks.positions if s <= end + ARC_TOLERANCE))
        if len(arcs) != len(holes) or len(arcs) < 2:  # reported by the caller; stands for the list meanwhile
            return PointsRouting((0.0, *disks.positions), ((0.0, 0.0),) * (len(disks.positions) + 1))
        return PointsRouting(arcs, holes)
    fields = [f for f in ("offset", "angle_deg", "turns", "end_offset") if f in values]
    routing: Routing = ROUTINGS[kind](**{f: values[f] for f in fields})
    return routing


# ---------------------------------------------------------------------------------------- model and loading


def _build_model(data: Any, report: Report) -> Model | None:
    values, bad = _check(_ModelTable, data, "model", report)
    contradiction = values.get("tendon_path") == "continuous" and values.get("friction", "none") != "none"
    if contradiction:
        given = _text(data["friction"]) if "friction" in data else 'not given, so "per-hole"'
        report(
            "model.friction",
            given,
            'tendon_path = "continuous" is the classical model, which has no friction; set friction = "none"',
        )
    if bad or contradiction:
        return None
    values["gravity"] = _triple(values["gravity"])
    return Model(**values)


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return float(x), float(y), float(z)


def _build_step(i: int, data: Any, parts: _RobotParts, report: Report) -> LoadStep | None:
    key = f"steps[{i}]"
    count = 0

    def note(where: str, value: str, allowed: str) -> None:
        nonlocal count
        count += 1
        report(where, value, allowed)

    values, _ = _check(_StepTable, data, key, note)
    given: dict[str, dict[str, Any]] = {}
    for kind in ("tensions", "displacements"):
        raw = data.get(kind) if isinstance(data, dict) else None
        given[kind] = raw if isinstance(raw, dict) else {}
        for name, value in given[kind].items():
            if parts.names is not None and name not in parts.names:
                there = ", ".join(dict.fromkeys(parts.names)) or "none"
                sentence = f"unknown tendon{_meant(name, parts.names)}; the robot has {there}"
                note(_path(key, kind, name), _text(value), sentence)
    for name in [n for n in given["tensions"] if n in given["displacements"]]:
        note(
            _path(key, "displacements", name),
            _text(given["displacements"][name]),
            f"tendon {name} has a tension in the same step; exactly one of the two is allowed",
        )
    loads = {}
    for name, table in values.get("loads", {}).items():
        where = _path(key, "loads", name)
        load, wrong = _check(_LoadTable, table, where, note)
        if parts.length is not None and load.get("at", 0.0) > parts.length + ARC_TOLERANCE:
            sentence = f"lies beyond the tip; must be an arc length from 0 to {parts.length:g} m"
            note(f"{where}.at", _text(load["at"]), sentence)
        if not wrong:
            loads[name] = Load(
                float(load["at"]), _triple(load["force"]), _triple(load["moment"]), load["frame"]
            )
    if count:
        return None
    return LoadStep(
        label=values["label"],
        tensions=_floats(values["tensions"]),
        displacements=_floats(values["displacements"]),
        loads=loads,
        substeps=values["substeps"],
        time=None if values["time"] is None else float(values["time"]),
    )


def _check_times(tables: Sequence[Any], report: Report) -> None:
    """Times of the steps must not run backwards."""
    last = 0.0
    for i, table in enumerate(tables):
        time = table.get("time") if isinstance(table, dict) else None
        if isinstance(time, (int, float)) and time == time:
            if time < last:
                report(f"steps[{i}].time", _text(time), f"must not be before the step before, at {last:g} s")
            last = max(last, time)


# --------------------------------------------------------------------------------------------------- reading


def _load(
    path: Path, problems: list[Problem], named: Problem | None = None
) -> tuple[dict[str, Any] | None, str]:
    """Contents of a TOML file and its digest; None where it cannot be read, with the reason in ``problems``.

    ``named`` is where another file names this one, and takes the blame for a file that is not there.
    """
    file = str(path)

    def refuse(reason: str) -> tuple[None, str]:
        problems.append(replace(named, allowed=reason) if named else Problem(file, "", "", reason))
        return None, ""

    try:
        if path.is_dir():
            return refuse(f"{file} is a directory, not a file" if named else "is a directory, not a file")
        if not path.exists():
            there = sorted(p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else []
            near = difflib.get_close_matches(path.name, there, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            return refuse((f"there is no file {file}" if named else "no such file") + hint)
        if not path.is_file():
            return refuse(f"{file} is not a regular file" if named else "is not a regular file")
        raw = path.read_bytes()
    except (OSError, ValueError) as error:
        return refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{raw[error.start]:02x}"
        problems.append(Problem(file, f"line {line}", byte, "is not UTF-8; save the file in that encoding"))
        return None, ""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        place = re.search(r"\s*\(at (.*)\)$", message)
        where = place.group(1) if place else ""
        reason = message[: place.start()] if place else message
        problems.append(Problem(file, where, "", f"not TOML: {reason}"))
        return None, ""
    except (ValueError, RecursionError) as error:
        problems.append(Problem(file, "", "", f"not TOML that can be read: {str(error).partition(';')[0]}"))
        return None, ""
    return data, hashlib.sha256(raw).hexdigest()


def _reporter(problems: list[Problem], file: str) -> Report:
    def report(key: str, value: str, allowed: str) -> None:
        problems.append(Problem(file, key, value, allowed))

    return report


def digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def read_robot(path: str | os.PathLike[str]) -> Robot:
    """Read `robot.toml`.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    problems: list[Problem] = []
    path = Path(path)
    data, _ = _load(path, problems)
    robot = None if data is None else _build_robot(data, _reporter(problems, str(path))).robot
    if problems or robot is None:
        raise InputError(problems)
    return robot


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read `model.toml`, which holds the `[model]` table alone.

    Raises
    ------
    InputError
        With every mistake in the file.
    """
    problems: list[Problem] = []
    path = Path(path)
    data, _ = _load(path, problems)
    model = None
    if data is not None:
        report = _reporter(problems, str(path))
        top, _ = _check(_ModelFile, data, "", report)
        model = _build_model(top["model"], report) if "model" in top else None
    if problems or model is None:
        raise InputError(problems)
    return model


def read_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Read `scenario.toml` and the `robot.toml` that it names.

    Raises
    ------
    InputError
        With every mistake in both files.
    """
    problems: list[Problem] = []
    path = Path(path)
    data, scenario_digest = _load(path, problems)
    if data is None:
        raise InputError(problems)
    report = _reporter(problems, str(path))
    top, _ = _check(_ScenarioFile, data, "", report, EXTRA_TABLES)

    parts = _RobotParts()
    robot_path, robot_digest = path, ""
    if "robot" in top:
        robot_path = path.parent / top["robot"]
        named = Problem(str(path), "robot", _text(top["robot"]), "")
        robot_data, robot_digest = _load(robot_path, problems, named)
        if robot_data is not None:
            parts = _build_robot(robot_data, _reporter(problems, str(robot_path)))

    model = _build_model(top["model"], report) if "model" in top else None
    tables = top.get("steps", [])
    steps = [_build_step(i, table, parts, report) for i, table in enumerate(tables)]
    _check_times(tables, report)

    robot = parts.robot
    sound = tuple(s for s in steps if s is not None)
    if not problems and robot is not None and model is not None:
        for name in EXTRA_TABLES.keys() & data.keys():
            robot, model, sound = EXTRA_TABLES[name](data[name], robot, model, sound, report)
    if problems or robot is None or model is None:
        raise InputError(problems)
    return Scenario(
        robot,
        model,
        sound,
        path,
        robot_path,
        {str(path): scenario_digest, str(robot_path): robot_digest},
    )


# --------------------------------------------------------------------------------------------------- writing


def _toml(value: Any) -> str:
    """A number, text, list or flat mapping as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_toml(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(int(value)) if isinstance(value, int) else repr(float(value))


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(k)} = {_toml(v)}" for k, v in table.items() if v is not None]


def robot_to_toml(robot: Robot) -> str:
    """A robot as the text of a `robot.toml`, from which `read_robot` makes an equal one.

    Parameters
    ----------
    robot
        Its `metadata` is not written.

    Raises
    ------
    ValueError
        The robot has what the file format cannot express, such as a precurvature; all of it is named.
    """
    backbone, disks = robot.backbone, robot.disks
    beyond = {
        "backbone.precurvature": any(backbone.precurvature),
        "backbone.superelastic": backbone.superelastic is not None,
        "backbone.patches": bool(backbone.patches),
        "tip_mass": robot.tip_mass != 0.0,
    }
    for i, tendon in enumerate(robot.tendons):
        beyond[f"tendons[{i}].adhesion"] = tendon.adhesion != 0.0
        beyond[f"tendons[{i}].friction"] = tendon.friction is not None
        beyond[f"tendons[{i}].clearance"] = tendon.clearance != 0.0
        beyond[f"tendons[{i}].routing ({tendon.routing.kind})"] = tendon.routing.kind not in _TENDON_TABLES
    inexpressible = [key for key, is_so in beyond.items() if is_so]
    if inexpressible:
        raise ValueError(f"robot {robot.name!r}: robot.toml cannot express {', '.join(inexpressible)}")

    lines = [*_lines({"name": robot.name}), "", "[backbone]"]
    lines += _lines({name: getattr(backbone, name) for name in _BackboneTable.model_fields})
    lines += ["", "[disks]"]
    spaced = Disks.equally_spaced(len(disks.positions), backbone.length)
    if spaced.positions == disks.positions:
        lines += _lines({"count": len(disks.positions)})
    else:
        lines += _lines({"positions": disks.positions})
    lines += _lines({"mass": disks.mass, "thickness": disks.thickness, "radius": disks.radius})
    for tendon in robot.tendons:
        values: dict[str, Any] = {"name": tendon.name, "routing": tendon.routing.kind}
        for name in ("offset", "end_offset", "turns", "angle_deg", "holes"):
            if name in _TENDON_TABLES[tendon.routing.kind].model_fields:
                values[name] = getattr(tendon.routing, name)
        values["friction_coefficient"] = tendon.friction_coefficient
        values |= {"end": tendon.end, "axial_stiffness": tendon.axial_stiffness}
        lines += ["", "[[tendons]]", *_lines(values)]
    return "\n".join(lines) + "\n"


def model_to_toml(model: Model) -> str:
    """A model as the text of a `model.toml`, from which `read_model` makes an equal one."""
    values = {name: getattr(model, name) for name in _ModelTable.model_fields}
    return "\n".join(["[model]", *_lines(values)]) + "\n"


def scenario_to_toml(model: Model, steps: Iterable[LoadStep], robot: str = "robot.toml") -> str:
    """Model and loading sequence as the text of a `scenario.toml`.

    Parameters
    ----------
    model, steps
        What is written.
    robot
        Path of the `robot.toml`, relative to where the scenario will lie.
    """
    lines = [f"robot = {_toml(robot)}", "", model_to_toml(model).rstrip()]
    for step in steps:
        lines += ["", "[[steps]]", *_lines({"label": step.label or None})]
        lines += _lines({"tensions": step.tensions or None, "displacements": step.displacements or None})
        loads = {
            name: {"at": x.at, "force": x.force, "moment": x.moment, "frame": x.frame}
            for name, x in step.loads.items()
        }
        lines += _lines({"loads": loads or None, "substeps": step.substeps, "time": step.time})
    return "\n".join(lines) + "\n"
