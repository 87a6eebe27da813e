"""The report as one HTML page: verdict line, claims, and a section for every part."""

from __future__ import annotations

from typing import Any

from tdcr_fe.report.page import Level, Page, Picture, Section, render
from tdcr_fe.validation.paper.cases import MODEL_NAMES
from tdcr_fe.validation.paper.report.document import PAPER
from tdcr_fe.validation.paper.report.figures import drawings
from tdcr_fe.validation.paper.run import PaperRun
from tdcr_fe.validation.paper.studies.signs import sign_steps
from tdcr_fe.validation.paper.tables import typed_table

#: Where the templates are.
PACKAGE = "tdcr_fe.validation.paper"


def _row_by_row(readings: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Offset and angle of one place and state beside each other."""
    lines: dict[tuple[int, bool, str], dict[str, Any]] = {}
    for r in readings:
        line = lines.setdefault(
            (r["row"], r["loaded"], r["place"]),
            {k: r[k] for k in ("row", "loaded", "place", "consistent")} | {"offset": None, "angle": None},
        )
        line[r["quantity"]] = r
    return [lines[k] for k in sorted(lines)]


#: Level of a mark, by verdict.
_LEVELS: dict[str, Level] = {
    "holds": "good",
    "holds in part": "part",
    "does not hold": "bad",
    "not found": "bad",
    "matters": "part",
    "matters little": "good",
}


def context(data: dict[str, Any]) -> dict[str, Any]:
    """What all templates get."""
    return {
        "data": data,
        "models": MODEL_NAMES,
        "typed": {int(k): typed_table(int(k)).to_dict("records") for k in data["tables"]},
        "lines": {k: _row_by_row(t["readings"]["declared"]) for k, t in data["tables"].items()},
        "sign_steps": {s.label: s for s in sign_steps()},
        "paper": PAPER,
    }


def _headline(data: dict[str, Any]) -> tuple[str, Level]:
    """The verdict line over all claims, and its level."""
    found = [v["verdict"] for v in data["verdicts"]]
    counts = {name: found.count(name) for name in _LEVELS if name in found}
    judged = {n: c for n, c in counts.items() if not n.startswith("matters")}
    text = ", ".join(
        f"{count} {name.replace('holds', 'hold').replace('does not', 'do not') if count > 1 else name}"
        for name, count in judged.items()
    )
    named = [
        f"{c} limitations {n.replace('matters', 'matter') if c > 1 else n}"
        for n, c in counts.items()
        if n not in judged
    ]
    line = f"Of the paper's claims {text}." if judged else "No claim was tested."
    if data["interrupted"]:
        return f"Unfinished: interrupted in {data['interrupted']}. {line}", "open"
    level: Level = (
        "good"
        if set(judged) <= {"holds"} and judged
        else "part"
        if "holds" in judged or "holds in part" in judged
        else "bad"
    )
    return line + (f" {'; '.join(named)}." if named else ""), level


#: Sections: the part of the data that must be there, title, template.
_SECTIONS = (
    ("figures", "Figures 3 to 6", "figures"),
    ("tables", "Tables 1 to 4, row by row", "tables"),
    ("missing", "What the declared robots lack: identification on the tables", "missing"),
    ("critical_loads", "Critical loads in the helical case", "critical"),
    ("signs", "The algorithm of Fig. 2", "signs"),
    ("stiffness", "Stiffness from loads and displacements (section 3.4, Eqs. 36 to 40)", "stiffness"),
    ("disk_thickness", "Limitations that the paper names", "limits"),
)


def page(run: PaperRun, data: dict[str, Any]) -> Page:
    """What the report shows."""
    verdict, level = _headline(data)
    pictures = {
        name: Picture(text, _ALT.get(name, f"Shapes and loading sequence of {name}"))
        for name, text in drawings(run).items()
    }
    shared = {**context(data), "drawings": pictures}
    interrupted = (
        f"Interrupted in “{data['interrupted']}”: this part and all later parts are missing."
        if data["interrupted"]
        else ""
    )
    return Page(
        title="Reproduction of the paper",
        verdict=verdict,
        level=level,
        sentences=tuple(
            filter(
                None,
                (
                    interrupted,
                    f"{PAPER}, doi:10.3390/mi16030346. Evidence and reason unfold under each claim.",
                ),
            )
        ),
        summary=Section("verdicts", "", "verdicts.html.j2", {"verdicts": data["verdicts"], "mark": _LEVELS}),
        sections=tuple(
            Section(name, title, f"{name}.html.j2", shared) for key, title, name in _SECTIONS if data.get(key)
        ),
        notes=(
            f"tdcr-fe {data['versions']['tdcr_fe']}, Exudyn {data['versions']['exudyn']}, {data['wall_time_s']:.0f} s. "
            "Repeat with: tdcr-fe paper -o OUT",
        ),
    )


_ALT = {
    "tables": "Chord angles of the tables, measured and computed",
    "missing": "Chord angles, measured, as declared, and after each stage",
    "critical": "Smallest eigenvalue against load",
    "dynamics": "Tip against time",
}


def html(run: PaperRun, data: dict[str, Any]) -> str:
    """The report as one self-contained HTML page."""
    return render(page(run, data), PACKAGE)
