"""The tables of `sweep.toml` as data: how cases are chosen, what varies, and what is kept."""

from __future__ import annotations

from typing import Annotated, Any, cast

from tdcr_fe.io.problems import Reporter
from tdcr_fe.io.toml import Scenario
from tdcr_fe.model.messages import meant, quoted, shown
from tdcr_fe.model.schema import Keys, Quantity, keys_of
from tdcr_fe.sweeps.cases import columns_of_steps
from tdcr_fe.sweeps.description import Mode, Output, Range, Sampling, Variation
from tdcr_fe.sweeps.keys import KeyProblem, parse_key
from tdcr_fe.sweeps.sampling import DISTRIBUTIONS, SAMPLED, Distribution

#: Keys of ``[[vary]]`` that give its values; exactly one is given.
VALUES = ("values", "range", *DISTRIBUTIONS)


_TEXTS = "a list of keys in quotes, at least one"
#: Keys of ``[[vary]]``.
VARY = Keys(
    {
        "key": Annotated[str, Quantity("key", allowed="the key of a value, in quotes")],
        "keys": Annotated[tuple[str, ...], Quantity("keys", allowed=_TEXTS, min_items=1)],
        "name": Annotated[str, Quantity("of the column", name=True)],
        "mode": Annotated[Mode, Quantity("how the value acts on the declared one")],
        "values": Annotated[
            list[Any], Quantity("values", allowed="a list of values, at least one", min_items=1)
        ],
        "range": Annotated[Range, Quantity("values at equal distances")],
        **{n: Annotated[cls, Quantity(n)] for n, cls in DISTRIBUTIONS.items()},
    },
    {**dict.fromkeys(("key", "keys", "name", "values", "range", *DISTRIBUTIONS)), "mode": "value"},
)

_STEPS = 'one of "last", "all", or a list of the numbers of load steps, from 1'
#: Keys of ``[output]``.
OUTPUT = Keys(
    {
        "steps": Annotated[Any, Quantity("steps", allowed=_STEPS)],
        "quantities": Annotated[
            tuple[str, ...], Quantity("columns", allowed="a list of columns of steps.csv, in quotes")
        ],
    },
    {"steps": "last", "quantities": ()},
)


def read_sampling(table: Any, report: Reporter) -> Sampling | None:
    """The table ``[sampling]``; None where it has mistakes."""
    values, bad = keys_of(Sampling).read(table, "sampling", report.mistake)
    if bad or not isinstance(table, dict):
        return None
    sampling = Sampling(**values)
    if sampling.method not in SAMPLED and sampling.samples is not None:
        text = f"only for method = {', '.join(map(quoted, SAMPLED))}; {quoted(sampling.method)} takes all values given"
        report("sampling.samples", str(sampling.samples), text)
    if sampling.method in SAMPLED and sampling.samples is None:
        report(
            "sampling.samples", "", f"missing; method = {quoted(sampling.method)} needs a number of points"
        )
    if sampling.method in ("sobol", "saltelli") and (sampling.samples or 1).bit_count() != 1:
        text = f"must be a power of two for method = {quoted(sampling.method)}, such as 256, 512 or 1024"
        report("sampling.samples", str(sampling.samples), text)
    return sampling


def read_variation(i: int, table: Any, report: Reporter) -> Variation | None:
    """One table ``[[vary]]``; None where it has mistakes."""
    before, where = len(report.problems), f"vary[{i}]"
    values, _ = VARY.read(table, where, report.mistake)
    if not isinstance(table, dict):
        return None
    if ("key" in table) == ("keys" in table):
        both = "key" in table
        text = (
            "key and keys are both given; exactly one is allowed"
            if both
            else "missing; must be the key of a value"
        )
        report(f"{where}.key", shown(table["key"]) if both else "", text)
    keys = []
    for text in [values["key"]] if values.get("key") is not None else values.get("keys") or ():
        try:
            keys.append(parse_key(text))
        except KeyProblem as error:
            report(f"{where}.key", shown(text), str(error))
    given = [name for name in VALUES if name in table]
    if len(given) != 1:
        text = f"must have exactly one of {', '.join(VALUES)}" + (
            f"; it has {' and '.join(given)}" if given else ""
        )
        report(where, "", text)
    if len(report.problems) > before:
        return None
    options, distribution = _values(given[0], values[given[0]])
    name = values["name"] or keys[0].text
    if values["mode"] != "value" and not all(is_number(x) for x in options):
        report(f"{where}.mode", quoted(values["mode"]), "only for values that are numbers")
    if any(k.names_robot for k in keys) and not all(
        isinstance(x, str) for x in (*options, *(["?"] if options else [0]))
    ):
        report(f"{where}.values", "", 'must be paths of robot.toml files, in quotes, for key = "robot"')
    if len(report.problems) > before:
        return None
    return Variation(name, tuple(keys), values["mode"], options, distribution)


def _values(kind: str, given: Any) -> tuple[tuple[Any, ...], Distribution | None]:
    if kind == "values":
        return tuple(given), None
    if kind == "range":
        return cast(Range, given).values(), None
    return (), cast(Distribution, given)


def is_number(value: Any) -> bool:
    """Whether a value is a number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def read_output(table: Any, scenario: Scenario | None, report: Reporter) -> Output:
    """The table ``[output]``, checked against the load steps and the tendons of the scenario."""
    values, bad = OUTPUT.read(table, "output", report.mistake)
    if bad or not isinstance(table, dict) or scenario is None:
        return Output()
    count, steps = len(scenario.steps), values["steps"]
    chosen: tuple[int, ...] = ()
    if steps == "all":
        chosen = tuple(range(1, count + 1))
    elif isinstance(steps, list) and steps and all(type(k) is int and 1 <= k <= count for k in steps):
        chosen = tuple(dict.fromkeys(steps))
    elif steps != "last":
        report("output.steps", shown(steps), f"must be {_STEPS} to {count}")
    known = columns_of_steps(scenario.robot.tendon_names)
    for i, name in enumerate(values["quantities"]):
        if name not in known:
            report(
                f"output.quantities[{i}]",
                shown(name),
                f"unknown{meant(name, known)}; there are {', '.join(known)}",
            )
    return Output(chosen, tuple(dict.fromkeys(values["quantities"])))
