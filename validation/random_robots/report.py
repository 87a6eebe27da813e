"""What was found on random robots, as a table and in lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from tdcr_fe.validation.random_robots.comparison import TOLERANCE, Comparison


def to_frame(records: Sequence[Comparison]) -> pd.DataFrame:
    """One row a case."""
    rows = [
        {
            "number": r.number,
            "tendons": r.tendons,
            "disks": r.disks,
            "drive": r.drive,
            "passed": r.passed,
            "largest_gap": r.gap,
            "largest_estimate": max((s.estimate for s in r.steps), default=np.nan),
            "milliseconds_per_step": 1e3 * r.seconds / max(1, len(r.steps)),
            "seconds": r.seconds,
            "seconds_reference": r.seconds_reference,
            "failures": " | ".join(r.failures),
            "warnings": " | ".join(r.warnings),
        }
        for r in records
    ]
    return pd.DataFrame(rows)


def summary(records: Sequence[Comparison]) -> list[str]:
    """What was found, in lines."""
    steps = [step for record in records for step in record.steps]
    far = [step for step in steps if step.gap > TOLERANCE]
    times = np.array([step.milliseconds for step in steps]) if steps else np.full(1, np.nan)
    failed = [str(record.number) for record in records if not record.passed]
    gaps = np.array([step.gap for step in steps]) if steps else np.full(1, np.nan)
    return [
        f"{len(records)} robots, {len(steps)} load steps",
        f"largest distance of a disk over the length: median {np.median(gaps):.1e}, 99 % below "
        f"{np.quantile(gaps, 0.99):.1e}, worst {gaps.max():.1e}",
        f"{len(far)} steps differ by more than {100.0 * TOLERANCE:g} %, {sum(not step.passed for step in far)} of "
        "them unannounced",
        f"finite elements, processor time a step: median {np.median(times):.3g} ms, 90 % below "
        f"{np.quantile(times, 0.9):.3g} ms, worst {times.max():.3g} ms",
        f"processor time: finite elements {sum(r.seconds for r in records):.0f} s, reference "
        f"{sum(r.seconds_reference for r in records):.0f} s",
        "all passed" if not failed else f"{len(failed)} failed: {', '.join(failed)}",
    ]
