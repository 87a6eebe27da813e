"""The command ``tdcr-fe estimate``: shape, tensions and external force, frame by frame."""

from __future__ import annotations

import argparse

import numpy as np

from tdcr_fe.commands.common import Exit, complain, complain_of_left_out, print_understood, progress_bar, say
from tdcr_fe.estimate.report import write_estimates
from tdcr_fe.estimate.run import read_estimation, run_estimation
from tdcr_fe.io.files import check_output_folder, read_all
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import quantity


def run(args: argparse.Namespace) -> int:
    """Estimate the frames of a folder, and write them."""
    estimation, out = read_all(lambda: read_estimation(args.folder), lambda: check_output_folder(args.out))
    data = estimation.data
    complain_of_left_out(args, data.left_out)
    print_understood(args, data.robot, data.model, data.steps)
    with progress_bar(args, len(data.steps), unit="frame") as bar:
        result = run_estimation(estimation, lambda frame: bar.update(1))
    if not result.frames:
        complain("interrupted before the first frame; nothing is written")
        return Exit.INTERRUPTED
    written = write_estimates(result, out)
    frames = count(len(result.frames), "frame")
    times = np.quantile([frame.milliseconds for frame in result.frames], (0.5, 0.95))
    median, most = (quantity(1e-3 * time, "s") for time in times)
    say(args, f"{frames} estimated, {median} each (median), 95 % within {most}")
    say(args, f"Written to {out}: " + ", ".join(p.name for p in written))
    if result.failure:
        complain(result.failure)
    if result.interrupted:
        complain(f"interrupted after {frames}; what was estimated is written")
        return Exit.INTERRUPTED
    return Exit.FAILED if result.failure else Exit.DONE
