"""The paper's claims and limitations (claims.toml), judged by the results of all parts: verdict and evidence."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from tdcr_fe.validation.paper.cases import CASE_IDS
from tdcr_fe.validation.paper.tables import TABLES

#: Results of the parts, by name.
Parts = Mapping[str, Mapping[str, Any]]

#: Error of the mesh; smaller differences of the tip displacement do not order the models [mm].
TIE = 5e-2


@dataclass(frozen=True)
class Claim:
    """Verdict on one claim."""

    claim: str  # as the paper has it
    verdict: str  # "holds", "holds in part", "does not hold", "matters", "matters little"
    evidence: str  # the numbers
    reason: str
    expected: str  # the verdict that was found before


def claims(parts: Parts) -> list[Claim]:
    """Verdicts on all claims for which there are results."""
    judges = {
        "order": (CASE_IDS, lambda: _deforms_more(parts, "classical", "discrete")),
        "friction_order": (CASE_IDS, lambda: _deforms_more(parts, "discrete", "per-tendon")),
        "figures": (CASE_IDS, lambda: _figures(parts)),
        "accuracy": (_TABLES, lambda: _accuracy(parts)),
        "consistency": (_TABLES, lambda: _consistency(parts)),
        "bifurcation": (("critical",), lambda: _bifurcation(parts["critical"])),
        "signs": (("signs",), lambda: _signs(parts["signs"]["steps"])),
        "stiffness": (("stiffness",), lambda: _stiffness(parts["stiffness"])),
        "disks": (("limitations",), lambda: _limitation(parts["limitations"], "disks ")),
        "friction": (("limitations",), lambda: _limitation(parts["limitations"], "mN ", "friction ")),
        "dynamics": (("dynamics",), lambda: _dynamics(parts["dynamics"]["runs"])),
    }
    texts = tomllib.loads((files("tdcr_fe.validation.paper") / "claims.toml").read_text(encoding="utf-8"))
    found = []
    for name, (needed, judge) in judges.items():
        if all(part in parts for part in needed):
            verdict, evidence = judge()
            found.append(Claim(verdict=verdict, evidence=evidence, **texts[name]))
    return found


_TABLES = tuple(f"table{number}" for number in TABLES)


def _word(hits: int, count: int) -> str:
    """Verdict on a claim that is true in some of the states."""
    if hits == count:
        return "holds"
    return "does not hold" if 3 * hits < count else "holds in part"


def _deforms_more(parts: Parts, more: str, less: str) -> tuple[str, str]:
    """Whether one model deforms more than another, with and without load."""
    states: dict[tuple[str, str, bool], dict[str, float]] = {}
    for name in CASE_IDS:
        for row in parts[name]["states"]:
            key = (parts[name]["title"], row["state"], row["tendons alone"])
            states.setdefault(key, {})[row["model"]] = row["tip displacement [mm]"]
    texts, hits, counts = [], [0, 0], [0, 0]
    for (title, _, alone), sizes in states.items():
        gap = sizes[more] - sizes[less]
        hits[not alone] += gap > TIE
        counts[not alone] += abs(gap) > TIE
        if alone:
            texts.append(f"{title.split(':')[0]} {sizes[more]:.2f} and {sizes[less]:.2f} mm")
    true = f"{hits[0]} of {counts[0]} states without and {hits[1]} of {counts[1]} with load"
    return _word(
        sum(hits), sum(counts)
    ), f"Tip displacement by tendons alone: {'; '.join(texts)}. True in {true}."


def _figures(parts: Parts) -> tuple[str, str]:
    """Whether all figures were solved, and on a stable branch."""
    found = {name: parts[name] for name in CASE_IDS}
    failed = [f"{name}, {key}" for name, f in found.items() for key in f["failed"]]
    snapped = [f"{name}, {key}" for name, f in found.items() for key in f["snapped"]]
    smallest = min(f["smallest"] for f in found.values())
    gap = max(f["reference_gap"] for f in found.values())
    return (
        "holds" if not failed and smallest > 0.0 else "holds in part",
        f"{len(found)} cases with 4 models, from the unloaded state in small steps; not solved: "
        f"{', '.join(failed) or 'none'}; smallest eigenvalue of the tangent {smallest:.2f}; jumps: "
        f"{', '.join(snapped) or 'none'}; without friction, tip within {100 * gap:.1g} % of the length from the "
        "independent reference.",
    )


def _accuracy(parts: Parts) -> tuple[str, str]:
    """How far simulation and experiment deviate, as declared and after fitting."""
    declared = {name: parts[name]["mean_percent"]["declared"] for name in _TABLES}
    fitted = {name: min(parts[name]["mean_percent"].values()) for name in _TABLES}
    unloaded = {name: min(parts[name]["unloaded_percent"].values()) for name in _TABLES if name != "table2"}
    phi = np.deg2rad([row["angle_deg"] for row in parts["table1"]["rows"]])
    offsets = np.array([row["offset_mm"] for row in parts["table1"]["rows"]])
    contradiction = float(np.mean(np.abs(offsets - 250.0 * np.sin(phi) ** 2 / phi))) / 2.5
    texts = [f"Table {n[-1]} {x:.1f} % ({fitted[n]:.1f} % after fitting)" for n, x in declared.items()]
    alone = [f"Table {n[-1]} {x:.1f} %" for n, x in unloaded.items()]
    best = min(*fitted.values(), *unloaded.values())
    return (
        "holds" if best < 0.3 else "does not hold",
        f"Mean deviation of the offsets in per cent of the length, model as declared: {'; '.join(texts)}. Rows without "
        f"load, stiffness and dead band fitted: {'; '.join(alone)}. Offsets and angles of Table 1 alone disagree by "
        f"{contradiction:.1f} % of the length on average.",
    )


def _consistency(parts: Parts) -> tuple[str, str]:
    """How many rows of the tables contradict themselves or each other."""
    rows = [row for name in _TABLES for row in parts[name]["rows"]]
    shape, elastic = (sum(not row[key] for row in rows) for key in ("geometry_ok", "elastic_ok"))
    good = sum(row["geometry_ok"] and row["elastic_ok"] for row in rows)
    return (
        "does not hold" if 2 * good < len(rows) else "holds in part",
        f"{shape} of {len(rows)} rows have an offset and an angle that contradict each other, {elastic} a load or a "
        f"stiffness that contradicts the others. {good} rows pass every check.",
    )


def _bifurcation(part: Mapping[str, Any]) -> tuple[str, str]:
    """Whether a search found a critical load across the robot."""
    across = [s for s in part["searches"] if s["direction"] != "-z"]
    critical = [
        f"{s['critical']:.3f} N along {s['direction']} at {s['tension']:g} N of tension ({s['robot']}, {s['model']})"
        for s in across
        if s["critical"] is not None
    ]
    own = {s["direction"]: s for s in part["searches"] if s["tension"] == 1.2 and s["model"] == "discrete"}
    smallest = {direction: min(s["eigenvalues"]) for direction, s in own.items()}
    return (
        "holds in part" if critical else "does not hold",
        f"The paper's 1.2 N and load along +y: smallest eigenvalue {smallest['+y']:.2f} up to "
        f"{own['+y']['loads'][-1]:g} N (1 unloaded, 0 critical). {len(across)} searches across the robot of the "
        "simulation at 1.2 to 30 N and of the prototype at 5 to 30 N of tension, with and without friction: critical "
        f"only {'; '.join(critical) or 'nowhere'}. Pushed along -z at 1.2 N the eigenvalue falls to "
        f"{smallest['-z']:.2f}, and the tip moves by {own['-z']['rate']:.1f} m/N near {own['-z']['rate_at']:.2f} N. On "
        f"a straight column the same search finds {part['column']:.4f} N (Euler: {part['euler']:.4f} N).",
    )


def _signs(steps: list[Mapping[str, Any]]) -> tuple[str, str]:
    """Whether trying signs finds the friction of every load step."""
    without = [s["step"] for s in steps if s["consistent"] == "none"]
    first = next((k for k, s in enumerate(steps) if s["consistent"] == "none"), len(steps))
    gap = max(s["distance of the tips [mm]"] for s in steps[:first])
    solved = len(steps) - len(without)
    return (
        _word(solved, len(steps)),
        f"{solved} of {len(steps)} load steps have a consistent combination; up to the first that has none, the tips "
        f"agree with the implicit law to {max(gap, 1e-6):.0e} mm. None for: {', '.join(without) or '-'}.",
    )


def _stiffness(s: Mapping[str, Any]) -> tuple[str, str]:
    """Whether the stiffness found predicts new loads and the tip."""
    good = s["new load error"] < 0.02 and s["tip error"] < 0.1 * s["tip error as declared"]
    return (
        "holds" if good else "does not hold",
        f"From 8 forces of 2 and 4 mN with 0.05 mm of noise: EI {1e3 * s['found EI']:.3f}e-3 N m² where "
        f"{1e3 * s['true EI']:.3f}e-3 was put in; a new load is predicted to {100 * s['new load error']:.1f} %; the "
        f"tip at 1.5 N of tension is off by {1e3 * s['tip error']:.2f} mm instead of "
        f"{1e3 * s['tip error as declared']:.1f} mm. With ten times the forces the stiffness is "
        f"{s['large load factor']:.2f} times too large.",
    )


def _limitation(part: Mapping[str, Any], *words: str) -> tuple[str, str]:
    """How far something that the paper neglects moves the tip."""
    rows = [r for r in part["changes"] if any(word in r["change"] for word in words)]
    texts = [f"{r['change']}: {r['tip moves [mm]']:.2f} mm, {r['% of length']:.2f} %" for r in rows]
    verdict = "matters" if max(r["% of length"] for r in rows) > 0.5 else "matters little"
    return verdict, f"Fig. 3 at 1.5 N, the tip moves by {'; '.join(texts)}."


def _dynamics(runs: list[Mapping[str, float]]) -> tuple[str, str]:
    """How far the tip stays from its quasi-static position after a fast pull."""
    texts = [
        f"pulled in {r['pulled in [s]']:g} s: {r['overshoot [mm]']:.1f} mm beyond, at rest {r['left [mm]']:.2f} mm away"
        for r in runs
    ]
    verdict = "matters" if runs[0]["left [mm]"] > 1.0 else "matters little"
    return verdict, f"Fig. 3 to 1.5 N against the quasi-static tip: {'; '.join(texts)}."
