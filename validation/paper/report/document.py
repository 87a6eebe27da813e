"""All results of a run as one JSON document, without the shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdcr_fe.io.atomic import plain
from tdcr_fe.io.summary import versions
from tdcr_fe.model.results import StepResult
from tdcr_fe.validation.paper.claims import verdicts
from tdcr_fe.validation.paper.claims.order import Order, orders
from tdcr_fe.validation.paper.run import PaperRun
from tdcr_fe.validation.paper.studies.comparison import Deviation, Reading
from tdcr_fe.validation.paper.studies.critical import CriticalSearch
from tdcr_fe.validation.paper.studies.figures import CaseStudy, case_table
from tdcr_fe.validation.paper.studies.helical import euler_load
from tdcr_fe.validation.paper.studies.limitations import DynamicRun, Influence
from tdcr_fe.validation.paper.studies.missing import MissingStudy, remarks, tried
from tdcr_fe.validation.paper.studies.signs import SignStep
from tdcr_fe.validation.paper.studies.table_study import TableStudy
from tdcr_fe.validation.paper.tables import table_remarks, table_title

PAPER = (
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


def _figure(study: CaseStudy) -> dict[str, Any]:
    return {
        "title": study.case.title,
        "assumed": study.case.assumed,
        "states": case_table(study),
        "smallest_eigenvalue": {key: min(s.smallest for s in r.stabilities) for key, r in study.runs.items()},
        "snapped": {key: r.snapped for key, r in study.runs.items() if r.snapped},
        "failures": {key: r.failure for key, r in study.runs.items() if r.failure},
        "reference_gap_mm": {
            key: 1e3 * r.reference_gap for key, r in study.runs.items() if np.isfinite(r.reference_gap)
        },
    }


def _order(o: Order) -> dict[str, Any]:
    return {
        "case": o.case,
        "state": o.label,
        "tendons_alone": o.tendon_only,
        "tip_displacement_mm": {k: 1e3 * v for k, v in o.sizes.items()},
    }


def _table(number: int, study: TableStudy) -> dict[str, Any]:
    return {
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


def _sign_step(s: SignStep, own: StepResult) -> dict[str, Any]:
    return {
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


def _dynamic(d: DynamicRun) -> dict[str, Any]:
    return {
        "ramp_s": d.ramp,
        "overshoot_mm": 1e3 * d.overshoot,
        "left_mm": 1e3 * d.left,
        "swing_mm": 1e3 * d.swing,
    }


def _table1_variants(run: PaperRun) -> dict[str, Any]:
    """Other readings of the text beside Table 1, where they were computed."""
    if not (run.tables and run.printed_offset and run.simulation_rod and run.directions is not None):
        return {}
    return {
        "table1_variants": {
            "hole offset 0.43 mm as printed": _deviation(run.printed_offset),
            "rod of the simulation, R_b = 0.4 mm": _deviation(run.simulation_rod),
        },
        "table1_load_directions": run.directions.to_dict("records"),
    }


def _column(run: PaperRun) -> dict[str, Any]:
    """The critical load of a column, found and by Euler's formula."""
    if run.column is None or "fig5" not in run.cases:
        return {}
    return {"column": {"found_N": run.column.critical, "euler_N": euler_load(run.cases["fig5"].case.robot)}}


def _stiffness(run: PaperRun) -> dict[str, Any]:
    """The stiffness identified from loads and displacements."""
    s = run.stiffness
    if s is None:
        return {}
    return {
        "stiffness": {
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
    }


def to_json(run: PaperRun, wall_time: float) -> dict[str, Any]:
    """All results, without the shapes.

    Parameters
    ----------
    run
        Results.
    wall_time
        Of the run [s].
    """
    out: dict[str, Any] = {
        "paper": PAPER,
        "versions": versions(),
        "wall_time_s": wall_time,
        "seconds": run.seconds,
        "interrupted": run.interrupted,
        "verdicts": [v.__dict__ for v in verdicts(run)],
        "figures": {name: _figure(study) for name, study in run.cases.items()},
        "order_of_models": [_order(o) for o in orders(run)],
        "tables": {str(number): _table(number, study) for number, study in run.tables.items()},
        "critical_loads": [_search(k, s) for k, s in run.searches.items()],
        "critical_loads_prototype": [_search(k, s) for k, s in run.prototype_searches.items()],
        "signs": [_sign_step(s, own) for s, own in zip(run.signs, run.signs_own, strict=True)],
        "disk_thickness": [_influence(x) for x in run.thickness],
        "nonlinear_friction": [_influence(x) for x in run.friction],
        "dynamics": [_dynamic(d) for d in run.dynamics],
        "missing": [_missing(m) for m in run.missing.values()],
        **_table1_variants(run),
        **_column(run),
        **_stiffness(run),
    }
    return dict(plain(out))
