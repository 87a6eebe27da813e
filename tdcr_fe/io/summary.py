"""Contents of `summary.json`: versions, input, model, settings, convergence and warnings of a run."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Mapping
from typing import Any

from tdcr_fe import __version__
from tdcr_fe.compiled import is_compiled, numba_version
from tdcr_fe.model.results import LocalResponse, SequenceResult, StepResult
from tdcr_fe.report.motion import geometry


def versions() -> dict[str, str]:
    """Versions of this package and of the libraries that its results depend on."""
    found = {"tdcr_fe": __version__}
    for name in ("exudyn", "numpy", "scipy"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return {
        **found,
        "numba": (numba_version() if is_compiled() else None) or "not used",
        "python": platform.python_version(),
    }


def _response(found: LocalResponse) -> dict[str, Any]:
    """Response of a node, its matrices as lists of rows."""
    return {
        "holes": "reversal" if found.reversal else "as they are",
        "s": found.s,
        "compliance": found.compliance.tolist(),
        "by_tension": found.by_tension.tolist(),
        "by_displacement": found.by_displacement.tolist(),
        "motor_stiffness": found.motor_stiffness.tolist(),
    }


def _inputs(result: SequenceResult, step: StepResult) -> dict[str, Any]:
    """Loads that act at the end of a step, and tendons driven by displacement; without what there is not."""
    state = step.actuation
    if state is None:
        return {}
    loads = {
        name: {"at": x.at, "force": list(x.force), "moment": list(x.moment), "frame": x.frame}
        for name, x in state.loads.items()
        if any(x.force) or any(x.moment)
    }
    names = result.robot.tendon_names
    driven = [n for n, driven in zip(names, state.by_displacement, strict=True) if driven]
    return {**({"loads": loads} if loads else {}), **({"displacement_controlled": driven} if driven else {})}


def summary(
    result: SequenceResult, digests: Mapping[str, str] | None = None, steps_asked: int | None = None
) -> dict[str, Any]:
    """The contents of `summary.json`.

    Parameters
    ----------
    result
        What was solved.
    digests
        SHA-256 of the input files, by name.
    steps_asked
        Number of steps in the loading sequence; None means that all of it was solved.
    """
    model = result.model
    return {
        "versions": versions(),
        "input": {name: {"sha256": sha256} for name, sha256 in (digests or {}).items()},
        "robot": {"name": result.robot.name, "tendons": list(result.robot.tendon_names)},
        "model": {
            "tendon_path": model.tendon_path,
            "friction": model.friction,
            "elements_per_bay": model.elements_per_bay,
            "gravity": list(model.gravity),
        },
        "geometry": geometry(result),
        "mesh": {"elements_per_bay": list(result.elements_per_bay)},
        "settings": dict(result.settings),
        "wall_time": result.wall_time,
        "converged": result.converged,
        "steps_asked": len(result.steps) if steps_asked is None else steps_asked,
        "steps_solved": sum(s.converged for s in result.steps),
        "failed_step": result.failed_step,
        "message": result.message,
        "warnings": list(result.warnings),
        "steps": [
            {
                "step": s.step,
                "label": s.label,
                "converged": s.converged,
                "iterations": s.iterations,
                "substeps": s.substeps,
                "residual": s.residual,
                "discretisation_error": s.discretisation_error,
                "buckling_load_fraction": s.buckling_load_fraction,
                **_inputs(result, s),
                **({"tip_response": [_response(r) for r in s.responses]} if s.responses else {}),
            }
            for s in result.steps
        ],
    }
