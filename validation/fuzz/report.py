"""Tables of a fuzz campaign."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pandas as pd

from tdcr_fe.validation.fuzz.campaign import TOLERANCES, Outcome


def to_frame(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """One row a case."""
    rows = [
        {
            "case": o.number,
            "steps": o.steps,
            "solved": o.solved,
            "passed": o.passed,
            "broken": "; ".join(o.broken),
            "error": o.error,
            "message": o.message,
            "warnings": len(o.warnings),
            "seconds": o.seconds,
            "options": "; ".join(o.options),
            **{name: o.worst.get(name, np.nan) for name in TOLERANCES},
            **o.announced,
        }
        for o in outcomes
    ]
    return pd.DataFrame(rows)


def checks_table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """By check: cases, median and largest value, tolerance, and cases beyond it."""
    rows = []
    for name, tolerance in TOLERANCES.items():
        values = np.array([o.worst[name] for o in outcomes if name in o.worst])
        if values.size:
            rows.append(
                (
                    name,
                    values.size,
                    np.median(values),
                    values.max(),
                    tolerance,
                    int((values > tolerance).sum()),
                )
            )
    return pd.DataFrame(rows, columns=["check", "cases", "median", "largest", "tolerance", "beyond"])


def options_table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """By option of the robot: cases, those that did not converge, those with a broken check or an error."""
    rows = []
    for option in sorted({x for o in outcomes for x in o.options}):
        own = [o for o in outcomes if option in o.options]
        failed = sum(not o.converged and not o.error for o in own)
        rows.append((option, len(own), failed, sum(bool(o.broken or o.error) for o in own)))
    return pd.DataFrame(rows, columns=["option", "cases", "not converged", "wrong"])


def reason(message: str) -> str:
    """A message without its numbers, to count those that are alike."""
    text = re.sub(r"^step \d+ \([^)]*\) ", "", message)
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", text)[:120]


def summary(outcomes: Sequence[Outcome]) -> list[str]:
    """Counts, tables, and the cases that did not pass."""
    steps, solved = sum(o.steps for o in outcomes), sum(o.solved for o in outcomes)
    failed = [o for o in outcomes if not o.converged and not o.error]
    wrong = [o for o in outcomes if o.broken or o.error]
    lines = [
        f"{len(outcomes)} robots, {steps} load steps, {solved} solved; {len(failed)} robots did not converge, "
        f"{len(wrong)} are wrong; processor time of a robot: median "
        f"{np.median([o.seconds for o in outcomes]):.2f} s, worst {max(o.seconds for o in outcomes):.1f} s",
        "",
        checks_table(outcomes).to_string(index=False),
        "",
        options_table(outcomes).to_string(index=False),
        "",
    ]
    for text, count in Counter(reason(o.message) for o in failed).most_common(8):
        lines.append(f"{count} did not converge: {text}")
    for o in (wrong + failed)[:30]:
        what = o.error or ", ".join(f"{n} {o.worst[n]:.1e}" for n in o.broken) or o.message[:100]
        lines.append(f"{o.number}: {what} ({', '.join(o.options)})")
    return lines
