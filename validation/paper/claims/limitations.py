"""Limitations that the paper names: how much each of them changes its results."""

from __future__ import annotations

from tdcr_fe.validation.paper.claims.verdict import Verdict
from tdcr_fe.validation.paper.run import PaperRun


def thickness(run: PaperRun) -> list[Verdict]:
    """How far thick disks move the tip."""
    parts = [f"{x.name}: {1e3 * x.tip_shift:.1f} mm, {x.percent:.1f} %" for x in run.thickness]
    return [
        Verdict(
            "Limitation: disk thickness is neglected",
            "matters",
            "Fig. 3 at 1.5 N, tip moves by " + "; ".join(parts) + ".",
            "Glued disks take their thickness out of the length that bends: 13 disks of 1 mm are 5 % of 250 "
            "mm. Seen from "
            "the tip it is the same as a stiffer rod, so it hides in the identified stiffness.",
        )
    ]


def friction(run: PaperRun) -> list[Verdict]:
    """How far adhesion and pressure-dependent friction move the tip."""
    parts = [f"{x.name}: {1e3 * x.tip_shift:.2f} mm, {x.percent:.2f} %" for x in run.friction]
    return [
        Verdict(
            "Limitation: nonlinear friction is neglected",
            "matters",
            "Fig. 3 at 1.5 N, tip moves by " + "; ".join(parts) + ".",
            "With uniform bending the tendon presses about equally on every hole, so a coefficient that depends on the "
            "pressure acts "
            "like another constant coefficient; what changes is how it grows from one tension to the next. "
            "Adhesion reduces "
            "small and large tensions by the same amount, which a coefficient cannot represent.",
        )
    ]


def dynamics(run: PaperRun) -> list[Verdict]:
    """How far the tip stays from its quasi-static position after a fast pull."""
    parts = [
        f"pulled in {d.ramp:g} s: {1e3 * d.overshoot:.1f} mm beyond, at rest {1e3 * d.left:.2f} mm away"
        for d in run.dynamics
    ]
    slow = run.dynamics[-1]
    return [
        Verdict(
            "Limitation: quasi-static only",
            "matters" if run.dynamics[0].left > 1e-3 else "matters little",
            "Fig. 3 to 1.5 N against the quasi-static tip: " + "; ".join(parts) + ".",
            "With friction part of the overshoot remains, because the holes stick. Slower than three "
            "periods of the first "
            f"mode (0.3 s) it is small, and {1e3 * slow.left:.1f} mm at {slow.ramp:g} s; weights applied manually "
            "are in between.",
        )
    ]
