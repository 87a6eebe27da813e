"""Tables of the outcomes of broken files."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from tdcr_fe.validation.broken_files.campaign import RIGHT, Outcome


def to_frame(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """One row an input."""
    return pd.DataFrame([vars(o) for o in outcomes])


def summary(outcomes: Sequence[Outcome]) -> list[str]:
    """Counts by command and outcome, and the first of the wrong ones."""
    table = to_frame(outcomes)
    counts = table.pivot_table(
        index="inputs", columns="outcome", values="number", aggfunc="count", fill_value=0
    )
    lines = [counts.astype(int).to_string(), ""]
    wrong = [o for o in outcomes if o.outcome not in RIGHT]
    for o in wrong[:20]:
        what = f"{o.number}: {o.outcome}: {o.inputs}, {o.file}, {o.mutation}, {o.key} = {o.value!r}"
        lines += [what, *(f"    {line}" for line in o.text.strip().splitlines()[-3:])]
    lines.append(f"{len(outcomes)} broken inputs, {len(wrong)} of them not judged right")
    return lines


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """Counts by mutation, for the documentation."""
    table = to_frame(outcomes)
    counts = table.pivot_table(
        index="mutation", columns="outcome", values="number", aggfunc="count", fill_value=0
    )
    counts = counts.astype(int)
    head = ["mutation", *counts.columns]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * len(counts.columns)]
    for name, row in counts.iterrows():
        lines.append(f"| {str(name).replace('_', ' ')} | " + " | ".join(str(x) for x in row) + " |")
    lines.append("| all | " + " | ".join(f"{x}" for x in counts.sum()) + " |")
    return "\n".join(lines) + "\n"
