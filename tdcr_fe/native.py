"""`CreateTDCR`, `SolveTDCR` and others as methods of ``exudyn.MainSystem``, beside the library's own."""

from __future__ import annotations

import exudyn as exu

from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.linearized import TDCREigenvalues, TDCRLinearized
from tdcr_fe.solve.statics import SolveTDCR


def register() -> None:
    """Make `CreateTDCR`, `SolveTDCR`, `TDCREigenvalues` and `TDCRLinearized` methods of every Exudyn system.

    Call it once, at any time; a second call changes nothing. The plain functions, which take ``mbs`` first, work
    without it.
    """
    for function in (CreateTDCR, SolveTDCR, TDCREigenvalues, TDCRLinearized):
        setattr(exu.MainSystem, function.__name__, function)
