"""A concentrated load on a robot in a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION

Array = NDArray[np.float64]
Frame = Literal["world", "section"]


@dataclass
class PointLoad:
    """Exudyn's items of one concentrated load.

    Attributes
    ----------
    mbs : exudyn.MainSystem
    lForce, lTorque
        Load numbers.
    frame : "world" or "section"
    """

    mbs: exu.MainSystem
    lForce: Any
    lTorque: Any
    frame: Frame

    def set(self, force: Sequence[float] | Array, moment: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> None:
        """Set force [N] and moment [N m], each of shape (3,), in the load's frame."""
        turn = BEAM_TO_SECTION.T if self.frame == "section" else np.eye(3)
        self.mbs.SetLoadParameter(self.lForce, "loadVector", turn @ np.asarray(force, dtype=float))
        self.mbs.SetLoadParameter(self.lTorque, "loadVector", turn @ np.asarray(moment, dtype=float))
