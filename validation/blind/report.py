"""Write a benchmark's tables: JSON, Markdown, and a picture of the confusion table."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.io.atomic import write_text
from tdcr_fe.validation.blind.scoring import NOISE_FLOOR, Score, summarise

#: Marks around the tables in a page of the documentation.
BEGIN, END = "<!-- tables of the benchmark: begin -->", "<!-- tables of the benchmark: end -->"


def write_report(scores: Sequence[Score], out: str | os.PathLike[str]) -> dict[str, Any]:
    """Write ``benchmark.json``, ``benchmark.md`` and ``confusion.png``.

    Parameters
    ----------
    scores
        Of all sets.
    out
        Folder.

    Returns
    -------
    dict
        The summary.
    """
    out = Path(out)
    good = [s for s in scores if s["outcome"] != "failed"]
    summary = summarise(good)
    summary["failed"] = len(scores) - len(good)
    document = {"summary": summary, "sets": list(scores)}
    write_text(json.dumps(document, indent=1, default=float), out / "benchmark.json")
    write_text(to_markdown(summary, scores), out / "benchmark.md")
    if good:
        _picture(good, out / "confusion.png")
    return summary


def write_into_page(text: str, page: str | os.PathLike[str]) -> None:
    """Put tables into a page of the documentation, between the marks `BEGIN` and `END`.

    Parameters
    ----------
    text
        Markdown.
    page
        File that contains both marks.

    Raises
    ------
    ValueError
        A mark is missing.
    """
    page = Path(page)
    old = page.read_text(encoding="utf-8")
    if BEGIN not in old or END not in old:
        raise ValueError(f"{page}: no {BEGIN} ... {END} to put the tables in")
    before, rest = old.split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    write_text(f"{before}{BEGIN}\n\n{text}\n{END}{after}", page)


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" + (f" ({100.0 * part / whole:.0f} %)" if whole else "")


def to_markdown(summary: dict[str, Any], scores: Sequence[Score]) -> str:
    """Summary, confusion table, and one row a set, as Markdown."""
    blocks = [
        _table(("what", "seen"), _summary_rows(summary)),
        _table(("hidden", "named, how often"), _confusion_rows(summary)),
    ]
    if summary.get("failed"):
        blocks.append(f"Sets that failed: {summary['failed']}.\n")
    blocks.append(_table(_SET_COLUMNS, [_set_row(s) for s in scores]))
    return "\n".join(blocks)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with its line breaks."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _named(counts: dict[str, int]) -> str:
    """How many sets have the right names, and how many of them among those reported as indistinguishable."""
    together = f", {counts['named_together']} among those named together" if counts["named_together"] else ""
    return _share(counts["right"] + counts["named_together"], counts["sets"]) + together


def _summary_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    clean, unlisted = summary["clean"], summary["off_list"]
    held, cover = summary["held_out_over_noise"], summary["coverage"]
    percent = round(100.0 * (NOISE_FLOOR - 1.0))
    return [
        ("one listed effect: right name", _named(summary["single"])),
        ("the same, noise up to 0.12 mm", _named(summary["single_small_noise"])),
        ("two listed effects: both names, no other", _named(summary["pair"])),
        ("clean data: nothing missing", _share(clean["right"], clean["sets"])),
        ("weak effects (about two sigma): right name", _named(summary["weak"])),
        (
            f"held-out error within {percent} % of the noise, right names",
            _share(held["within_15_percent"], held["sets"]),
        ),
        (
            "held-out error over the noise, median and largest",
            _ratio(held["median"]) + ", " + _ratio(held["largest"]),
        ),
        ("true parameter inside the 95 % interval", _share(cover["inside"], cover["parameters"])),
        ("effects at a place: kind and place right", _share(unlisted["right"], unlisted["sets"])),
        ("... right, or not called explained", _share(unlisted["never_explained"], unlisted["sets"])),
        (
            "... remainder in the very bay or at the very disk",
            _share(unlisted["in_the_bay"], unlisted["sets"]),
        ),
        ("... remainder within one bay, or at the right load", _share(unlisted["located"], unlisted["sets"])),
        ("time of one set, median and largest", _seconds(summary["seconds"])),
    ]


def _confusion_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """By hidden effects, what was named, the most frequent first."""
    rows = []
    for hidden, found in sorted(summary["confusion"].items()):
        frequent_first = sorted(found.items(), key=lambda x: -x[1])
        rows.append((hidden, ", ".join(f"{n} {k}" if k > 1 else n for n, k in frequent_first)))
    return rows


_SET_COLUMNS = (
    "seed",
    "robot",
    "drive",
    "noise [mm]",
    "hidden",
    "declared off [sigma]",
    "named",
    "verdict",
    "outcome",
    "held-out before, after / noise",
    "missed intervals",
)


def _set_row(s: Score) -> tuple[str, ...]:
    """Cells of one set, in the order of `_SET_COLUMNS`."""
    hidden = " + ".join(s["hidden"]) or "nothing"
    if s["outcome"] == "failed":
        return str(s["seed"]), "", "", "", hidden, "", "", "", f"failed: {s['error']}", "", ""
    rivals = s["indistinguishable_from"]
    named = " + ".join(n + (f" (or {', '.join(rivals[n])})" if rivals[n] else "") for n in s["named"])
    return (
        str(s["seed"]),
        s["robot"],
        s["drive"],
        f"{1e3 * s['sigma']:.3g}",
        hidden,
        f"{s['declared_off']:.3g}",
        named or "-",
        s["verdict"],
        s["outcome"],
        f"{s['before'] / s['noise_floor']:.3g}, {s['after'] / s['noise_floor']:.3g}",
        ", ".join(s["intervals_missed"]) or "-",
    )


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _seconds(times: dict[str, float | None]) -> str:
    return ", ".join("-" if t is None else f"{t:.0f} s" for t in (times["median"], times["largest"]))


def _picture(scores: Sequence[Score], file: Path) -> None:
    """How often an effect is named where another is hidden; sets with several effects count for each."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = [*sorted({n for s in scores for n in s["hidden"]}), "nothing"]
    columns = [
        *sorted({n for s in scores for n in s["named"]} | {r for r in rows if r != "nothing"}),
        "nothing",
    ]
    table = np.zeros((len(rows), len(columns)))
    for s in scores:
        for hidden in s["hidden"] or ["nothing"]:
            # a name that belongs to another hidden effect of the same set is no confusion
            others = set(s["hidden"]) - {hidden}
            for named in [n for n in s["named"] if n not in others] or ["nothing"]:
                table[rows.index(hidden), columns.index(named)] += 1
    figure = Figure(figsize=(0.42 * len(columns) + 2.6, 0.34 * len(rows) + 2.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.imshow(table, cmap="Blues", aspect="auto", vmin=0.0, vmax=max(1.0, float(table.max())))
    for i, j in zip(*np.nonzero(table), strict=True):
        dark = table[i, j] > 0.6 * table.max()
        right = rows[i] == columns[j]
        axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", fontsize=8,
                  color="white" if dark else "black" if right else "firebrick")  # fmt: skip
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.set_xlabel("named")
    axes.set_ylabel("hidden")
    figure.savefig(file, dpi=150)
