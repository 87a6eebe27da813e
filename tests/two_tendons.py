"""Two tendons without a robot, of four and of two segments, for tests of the friction along a tendon."""

from typing import Any

import numpy as np

from tdcr_fe.elements.friction import TendonLaw, TendonParameters
from tdcr_fe.elements.hysteresis import ElasticPlastic

LENGTHS = np.array([[0.02, 0.03, 0.02, 0.025], [0.02, 0.03, 0.0, 0.0]])
MASK = LENGTHS > 0.0
HOLES = MASK[:, 1:]
ANGLES = np.array([[0.2, 0.1, 0.3], [0.15, 0.0, 0.0]])


def tendon_law(
    model: Any,
    mu: float = 0.3,
    adhesion: float = 0.0,
    compliance: float = 0.0,
    presliding: float = 1e-6,
    hysteresis: Any = ElasticPlastic,
    coefficients: Any = (None, None),
) -> TendonLaw:
    """The equations of both tendons: friction model, the same numbers at every hole, or a law of the coefficient."""
    of_holes, of_tendons = (mu * HOLES, adhesion * HOLES), (np.full(2, compliance), np.zeros(2), np.zeros(2))
    follows = HOLES & np.array([[law is not None] for law in coefficients])
    parameters = TendonParameters(LENGTHS, MASK, *of_holes, *of_tendons, follows, coefficients)
    return TendonLaw(parameters, model, hysteresis(presliding))
