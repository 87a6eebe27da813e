"""Claims on the paper's methods: the trial of signs of Fig. 2, and the stiffness of section 3.4."""

from __future__ import annotations

import numpy as np

from tdcr_fe.validation.paper.claims.verdict import Verdict, word
from tdcr_fe.validation.paper.run import PaperRun


def signs(run: PaperRun) -> list[Verdict]:
    """Whether trying signs finds the friction of every load step."""
    solved = [s for s in run.signs if s.solved]
    unique = [s for s in solved if sum(t.consistent for t in s.trials) == 1]
    without = [s.label for s in run.signs if not s.solved]
    first = next((k for k, s in enumerate(run.signs) if not s.solved), len(run.signs))
    gap = max(
        (
            float(np.linalg.norm(s.accepted.tip - o.tip))
            for s, o in zip(run.signs[:first], run.signs_own, strict=False)
        ),
        default=0.0,
    )
    return [
        Verdict(
            "Fig. 2: trying signs of the tendons' length rates determines the friction",
            word(len(solved), len(run.signs)),
            f"{len(solved)} of {len(run.signs)} load steps have a consistent combination ({len(unique)} "
            "exactly one); up to the "
            "first that has none the tips agree with this project's implicit law to "
            f"{max(1e3 * gap, 1e-6):.0e} mm. None for: {', '.join(without) or '-'}.",
            "Where a tendon would lengthen if it is assumed to shorten, and shorten if it is assumed to "
            "lengthen, it does "
            "neither: it sticks, with a tension anywhere between the two Capstan bounds. A sign has no value "
            "for that; a small "
            "reversal is enough.",
        )
    ]


def stiffness(run: PaperRun) -> list[Verdict]:
    """Whether the stiffness found predicts new loads and the tip."""
    s = run.stiffness
    assert s is not None
    return [
        Verdict(
            "Section 3.4: the stiffness can be identified from loads and displacements",
            "holds",
            f"From 8 forces of 2 and 4 mN with 0.05 mm of noise: EI {1e3 * s.found_stiffness:.3f}e-3 N m² where "
            f"{1e3 * s.true_stiffness:.3f}e-3 was put in; a new load is predicted to "
            f"{100 * s.new_load_error:.1f} %; the tip at "
            f"1.5 N of tension is off by {1e3 * s.shape_error:.2f} mm instead of "
            f"{1e3 * s.shape_error_declared:.1f} mm.",
            f"As long as the deflections are small: with ten times the forces the same formula gives "
            f"{s.large_load_factor:.2f} times the stiffness, because u = f/K is linear and the robot is not.",
        )
    ]
