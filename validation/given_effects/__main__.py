"""The command ``python -m tdcr_fe.validation.given_effects``: what each of a list of effects takes away."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tdcr_fe.commands.common import FAILURE, SUCCESS, at_least_one


def main(argv: Sequence[str] | None = None) -> int:
    """Fit the effects and print a table.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 done, 1 a model was not solved, 2 the input is wrong, 130 interrupted.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tdcr_fe.validation.given_effects",
        description="Fit effects to measured data in a given order, and report the mean distance of the markers.",
    )
    parser.add_argument("folder", nargs="+", help="measured data, as for tdcr-fe identify")
    parser.add_argument("--effects", nargs="+", required=True, metavar="NAME", help="in the order of adding")
    parser.add_argument("--hold-out", nargs="+", required=True, metavar="PATTERN", help="branches")
    parser.add_argument("--every", type=at_least_one, default=1, metavar="N", help="every Nth step (1)")
    parser.add_argument("--friction", choices=("declared", "none"), default="declared", help="of the model")
    parser.add_argument("--processes", type=at_least_one, default=1, help="worker processes (1)")
    parser.add_argument(
        "--ceiling", action="store_true", help="what a regression of the residual leaves at best"
    )
    parser.add_argument("-o", metavar="FILE", help="where all values and errors by branch are written (JSON)")
    args = parser.parse_args(argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    from tdcr_fe.io.problems import InputError

    try:
        return _run(args)
    except (InputError, KeyError) as error:
        print(error.args[0] if isinstance(error, KeyError) else error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _run(args: argparse.Namespace) -> int:
    from dataclasses import replace

    from tdcr_fe.identify.explainable_variance import StepFeatures, predicted_residuals
    from tdcr_fe.identify.forward import ForwardModel
    from tdcr_fe.io.measured import join_measured, read_measured
    from tdcr_fe.validation.given_effects.stages import Stage, every_nth_step, fit_in_order, mean_distance

    data = join_measured([every_nth_step(read_measured(folder), args.every) for folder in args.folder])
    if args.friction == "none":
        data = replace(data, model=replace(data.model, friction="none"))
    print(f"{len(data.steps)} steps; mean distance of the markers, fitted and held out [mm]", flush=True)
    stages: list[Stage] = []
    with ForwardModel(args.processes, data.settings) as forward:
        begun = time.perf_counter()
        for stage in fit_in_order(data, args.effects, args.hold_out, forward):
            stages.append(stage)
            name = f"+ {stage.added}" if stage.added else "declared"
            seconds = time.perf_counter() - begun
            print(
                f"{1e3 * stage.fitted:7.2f} {1e3 * stage.held_out:7.2f}  {name}  ({seconds:.0f} s)",
                flush=True,
            )
        last = stages[-1]
        problem = last.problem
        if args.ceiling and last.fit.solved:
            features = StepFeatures.of(data)
            (predicted,) = predicted_residuals(problem, features, [last.fit.residual])
            left = last.fit.residual - predicted
            print(f"{'':7} {1e3 * mean_distance(problem, left, problem.held_out):7.2f}  after a regression")
    for name, values in last.fit.values.items():
        print(f"{name}: " + ", ".join(f"{key} = {value:.5g}" for key, value in values.items()))
    if args.o:
        Path(args.o).write_text(json.dumps([_document(s) for s in stages], indent=1), encoding="utf-8")
    return SUCCESS if all(s.fit.solved for s in stages) else FAILURE


def _document(stage: Any) -> dict[str, Any]:
    """A stage for a file: values, mean distances, and by branch."""
    from tdcr_fe.validation.given_effects.stages import mean_distance

    problem, residual = stage.problem, stage.fit.residual
    branch = dict(zip(problem.data.step_ids, problem.data.branches, strict=True))
    import numpy as np

    of_reading = np.array([branch[r.step] for r in problem.data.readings])
    return {
        "added": stage.added,
        "fitted": stage.fitted,
        "held_out": stage.held_out,
        "values": stage.fit.values,
        "by_branch": {
            b: mean_distance(problem, residual, of_reading == b) for b in dict.fromkeys(branch.values())
        },
        "residual": [float(x) for x in residual * problem.sigma],
    }


if __name__ == "__main__":
    raise SystemExit(main())
