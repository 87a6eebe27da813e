"""Result of a sweep as a few lines of text."""

from __future__ import annotations

import numpy as np

from tdcr_fe.model.messages import quoted
from tdcr_fe.sweeps.result import SweepResult
from tdcr_fe.sweeps.shown import shown, shown_outputs

#: Results that are printed before "and ... more".
MOST_PRINTED = 8


def as_text(result: SweepResult) -> str:
    """Cases by status, mean and range of the results that vary, the tip first, and the time."""
    states = ", ".join(f"{n} {status}" for status, n in result.counts.items())
    method, inputs = quoted(result.design.method), ", ".join(result.inputs)
    lines = [f"sweep of {len(result.cases)} cases by {method} over {inputs}: {states}"]
    found, names = result.statistics(), shown_outputs(result)
    for name in names[:MOST_PRINTED]:
        s, how = found[name], shown(name)
        mean, std, least, most = (how.factor * x for x in (s.mean, s.std, s.smallest, s.largest))
        lines.append(
            f"  {how.axis}: mean {mean:.6g}, standard deviation {std:.3g}, from {least:.6g} to {most:.6g}"
        )
    if len(names) > MOST_PRINTED:
        lines.append(f"  and {len(names) - MOST_PRINTED} more results")
    rate = result.solved_now / result.wall_time if result.wall_time > 0.0 else np.nan
    lines.append(f"  {result.solved_now} cases solved in {result.wall_time:.1f} s, {rate:.3g} a second")
    return "\n".join(lines)
