"""The report on the paper: a `PaperRun` as JSON, as one HTML page, and as a page of the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.io.atomic import plain, write_json, write_text
from tdcr_fe.io.measured import write_measured
from tdcr_fe.io.summary import versions
from tdcr_fe.report.environment import environment
from tdcr_fe.report.page import Level, Page, Picture, Section, render
from tdcr_fe.report.style import svg
from tdcr_fe.validation.paper.cases import MODEL_NAMES
from tdcr_fe.validation.paper.claims import case_table, orders, verdicts
from tdcr_fe.validation.paper.comparison import Deviation, Reading
from tdcr_fe.validation.paper.critical import CriticalSearch
from tdcr_fe.validation.paper.figures import (
    draw_case,
    draw_dynamics,
    draw_missing,
    draw_searches,
    draw_tables,
)
from tdcr_fe.validation.paper.limitations import Influence
from tdcr_fe.validation.paper.missing import MissingStudy, remarks, tried
from tdcr_fe.validation.paper.run import PaperRun, euler_load, sign_steps
from tdcr_fe.validation.paper.tables import table_remarks, table_title, typed_table

_PACKAGE = "tdcr_fe.validation.paper"
_PAPER = (
    "Wang, Du, Mao: Cosserat Rod-Based Tendon Friction Modeling, Simulation, and Experiments for Tendon-Driven "
    "Continuum Robots, Micromachines 2025, 16(3), 346"
)


def _deviation(d: Deviation) -> dict[str, Any]:
    return {
        "readings": d.count,
        "rms_offset_mm": 1e3 * d.rms_offset,
        "max_offset_mm": 1e3 * d.max_offset,
        "rms_angle_deg": np.rad2deg(d.rms_angle),
        "max_angle_deg": np.rad2deg(d.max_angle),
        "mean_percent": d.mean_percent,
    }


def _reading(r: Reading) -> dict[str, Any]:
    scale, unit = (1e3, "mm") if r.quantity == "offset" else (180.0 / np.pi, "deg")
    gap = r.model - r.measured
    # For an angle: the arc swept by the end of a chord as long as the robot up to that point.
    reach = 0.125 if r.place == "end of segment 1" else 0.25
    share = 100.0 * abs(gap) / 0.25 * (1.0 if r.quantity == "offset" else reach)
    return {
        "row": r.row,
        "loaded": r.loaded,
        "place": r.place,
        "quantity": r.quantity,
        "unit": unit,
        "measured": scale * r.measured,
        "model": scale * r.model,
        "deviation": scale * gap,
        "percent_of_length": share,
        "consistent": r.consistent,
    }


def _missing(m: MissingStudy) -> dict[str, Any]:
    found = None if m.result is None else m.result.to_json()
    return {
        "dataset": m.table.id,
        "title": m.table.title,
        "rows": m.table.rows,
        "readings": len(m.table.data.readings),
        "held_out_rows": m.held_out_rows,
        "stiffness_factor": m.stiffness_factor,
        "max_effects": m.max_effects,
        "stages": [
            {"model": s.name, "fitted": _deviation(s.fitted), "held_out": _deviation(s.held_out)}
            for s in m.stages
        ],
        "verdict": "not solved" if found is None else found["verdict"],
        "effects": [] if found is None else found["effects"],
        "remarks": remarks(m),
        "remaining": None if found is None else found["remaining"],
        "tried": [{"effect": n, "misfit_fitted": a, "misfit_held_out": b} for n, a, b in tried(m)],
        "left_out": [{"what": a, "reason": b} for a, b in m.table.left_out],
        "note": m.table.note,
        "in_files": m.table.in_files,
        "simulations": None if found is None else found["simulations"],
        "wall_time_s": None if found is None else found["wall_time"],
    }


def _search(key: tuple[float, str, str], s: CriticalSearch) -> dict[str, Any]:
    return {
        "tension_N": key[0],
        "direction": key[1],
        "model": key[2],
        "critical_N": s.critical,
        "how": s.how,
        "smallest_eigenvalue": s.smallest,
        "smallest_real_part": float(np.min(s.divergences)),
        "nearest_approach_mm": 1e3 * s.nearest,
        "loads_N": s.loads,
        "eigenvalues": s.eigenvalues,
        "largest_rate_m_per_N": s.largest_rate[0],
        "at_N": s.largest_rate[1],
    }


def _influence(x: Influence) -> dict[str, Any]:
    return {
        "change": x.name,
        "tip_mm": 1e3 * x.tip_shift,
        "percent_of_length": x.percent,
        "bending_angle_deg": np.rad2deg(x.angle_shift),
    }


def to_json(run: PaperRun, wall_time: float) -> dict[str, Any]:
    """All results, without the shapes."""
    out: dict[str, Any] = {
        "paper": _PAPER,
        "versions": versions(),
        "wall_time_s": wall_time,
        "seconds": run.seconds,
        "interrupted": run.interrupted,
        "verdicts": [v.__dict__ for v in verdicts(run)],
        "figures": {
            name: {
                "title": study.case.title,
                "assumed": study.case.assumed,
                "states": case_table(study),
                "smallest_eigenvalue": {
                    key: min(s.smallest for s in r.stabilities) for key, r in study.runs.items()
                },
                "snapped": {key: r.snapped for key, r in study.runs.items() if r.snapped},
                "failures": {key: r.failure for key, r in study.runs.items() if r.failure},
                "reference_gap_mm": {
                    key: 1e3 * r.reference_gap
                    for key, r in study.runs.items()
                    if np.isfinite(r.reference_gap)
                },
            }
            for name, study in run.cases.items()
        },
        "order_of_models": [
            {
                "case": o.case,
                "state": o.label,
                "tendons_alone": o.tendon_only,
                "tip_displacement_mm": {k: 1e3 * v for k, v in o.sizes.items()},
            }
            for o in (orders(run) if run.cases else [])
        ],
        "tables": {
            str(number): {
                "title": table_title(number),
                "rows": study.table.to_dict("records"),
                "remarks": table_remarks(number),
                "readings": {name: [_reading(r) for r in found] for name, found in study.readings.items()},
                "deviations": {
                    name: {part: _deviation(d) for part, d in parts.items()}
                    for name, parts in study.deviations.items()
                },
                "fits": {
                    name: {
                        "stiffness_factor": f.factor,
                        "dead_band_N": f.dead_band,
                        "rms_angle_deg": np.rad2deg(f.rms_angle),
                    }
                    for name, f in study.fits.items()
                },
            }
            for number, study in run.tables.items()
        },
        "critical_loads": [_search(k, s) for k, s in run.searches.items()],
        "critical_loads_prototype": [_search(k, s) for k, s in run.prototype_searches.items()],
        "signs": [
            {
                "step": s.label,
                "consistent": s.solved,
                "accepted": s.accepted.signs,
                "trials": [
                    {
                        "signs": t.signs,
                        "length_changes_mm": 1e3 * t.length_changes,
                        "agrees": t.agrees,
                        "consistent": t.consistent,
                    }
                    for t in s.trials
                ],
                "implicit_law": [states[0] for states in own.hole_states],
                "tip_gap_mm": 1e3 * float(np.linalg.norm(s.accepted.tip - own.tip)),
            }
            for s, own in zip(run.signs, run.signs_own, strict=True)
        ],
        "disk_thickness": [_influence(x) for x in run.thickness],
        "nonlinear_friction": [_influence(x) for x in run.friction],
        "dynamics": [
            {
                "ramp_s": d.ramp,
                "overshoot_mm": 1e3 * d.overshoot,
                "left_mm": 1e3 * d.left,
                "swing_mm": 1e3 * d.swing,
            }
            for d in run.dynamics
        ],
        "missing": [_missing(m) for m in run.missing.values()],
    }
    if run.tables and run.printed_offset and run.simulation_rod and run.directions is not None:
        out["table1_variants"] = {
            "hole offset 0.43 mm as printed": _deviation(run.printed_offset),
            "rod of the simulation, R_b = 0.4 mm": _deviation(run.simulation_rod),
        }
        out["table1_load_directions"] = run.directions.to_dict("records")
    if run.column is not None and "fig5" in run.cases:
        out["column"] = {"found_N": run.column.critical, "euler_N": euler_load(run.cases["fig5"].case.robot)}
    if run.stiffness is not None:
        s = run.stiffness
        out["stiffness"] = {
            "true_EI": s.true_stiffness,
            "declared_EI": s.declared_stiffness,
            "found_EI": s.found_stiffness,
            "matrix_N_per_m": s.identified.matrix,
            "regularisation_m2": s.identified.regularisation,
            "new_load_error": s.new_load_error,
            "tip_error_mm": 1e3 * s.shape_error,
            "tip_error_declared_mm": 1e3 * s.shape_error_declared,
            "large_load_factor": s.large_load_factor,
        }
    return dict(plain(out))


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


def _context(data: dict[str, Any]) -> dict[str, Any]:
    return {
        "data": data,
        "models": MODEL_NAMES,
        "typed": {int(k): typed_table(int(k)).to_dict("records") for k in data["tables"]},
        "lines": {k: _row_by_row(t["readings"]["declared"]) for k, t in data["tables"].items()},
        "sign_steps": {s.label: s for s in sign_steps()},
        "paper": _PAPER,
    }


def drawings(run: PaperRun) -> dict[str, str]:
    """Every drawing as SVG, by name."""
    found = {name: svg(draw_case(study)) for name, study in run.cases.items()}
    if run.tables:
        found["tables"] = svg(draw_tables(run))
    if run.missing:
        found["missing"] = svg(draw_missing(run))
    if run.searches:
        found["critical"] = svg(draw_searches(run))
    if run.dynamics:
        found["dynamics"] = svg(draw_dynamics(run))
    return found


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
    context = {**_context(data), "drawings": pictures}
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
                    f"{_PAPER}, doi:10.3390/mi16030346. Evidence and reason unfold under each claim.",
                ),
            )
        ),
        summary=Section("verdicts", "", "verdicts.html.j2", {"verdicts": data["verdicts"], "mark": _LEVELS}),
        sections=tuple(
            Section(name, title, f"{name}.html.j2", context)
            for key, title, name in _SECTIONS
            if data.get(key)
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
    return render(page(run, data), _PACKAGE)


def write_report(run: PaperRun, out: Path, wall_time: float) -> list[Path]:
    """Write ``report.html`` and ``report.json``.

    Parameters
    ----------
    run
        Results.
    out
        An existing directory.
    wall_time
        Of the run [s].
    """
    data = to_json(run, wall_time)
    html_file, numbers = out / "report.html", out / "report.json"
    write_json(data, numbers)
    write_text(html(run, data), html_file)
    return [html_file, numbers]


def write_datasets(run: PaperRun, folder: Path) -> list[Path]:
    """Write the data sets of the identification, one folder each, as far as files can express them."""
    written = []
    for name, study in run.missing.items():
        if study.table.in_files and study.result is not None:
            write_measured(study.result.data, folder / name)
            written.append(folder / name)
    return written


def write_docs(run: PaperRun, folder: Path, wall_time: float) -> list[Path]:
    """Write the documentation's page, ``paper.md``, and its pictures.

    Parameters
    ----------
    run
        Results.
    folder
        The ``docs`` folder.
    wall_time
        Of the run [s].
    """
    data = to_json(run, wall_time)
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in drawings(run).items():
        path = pictures / f"paper_{name}.svg"
        write_text(text, path)
        written.append(path)
    markdown = folder / "paper.md"
    write_text(environment(_PACKAGE).get_template("paper.md.j2").render(**_context(data)), markdown)
    return [markdown, *written]
