"""Names and habits of Exudyn's ``mbs.Create...`` functions beside those of `CreateTDCR`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tdcr_fe.model import arguments
from tdcr_fe.model.loading import Model
from tdcr_fe.scene.handle import TDCR


def one_of(ours: str, value: Any, theirs: str, other: Any) -> Any:
    """The value of an argument that has two names.

    Raises
    ------
    ValueError
        Both are given.
    """
    if value is not None and other is not None:
        raise ValueError(f"CreateTDCR: {ours} and {theirs} are two names of one argument; give one of them")
    return other if value is None else value


def with_gravity(model: Model, gravity: Sequence[float] | None) -> Model:
    """A model with the gravity that was given as an argument [m/s^2], if any.

    Raises
    ------
    ValueError
        The model has a gravity, too.
    """
    if gravity is None:
        return model
    arguments.check_numbers("CreateTDCR", "gravity", gravity, "[0, 0, -9.81] is that on earth.", count=3)
    if any(model.gravity):
        raise ValueError("CreateTDCR: gravity is given by the argument and by the model; give one of them")
    x, y, z = (float(g) for g in gravity)
    return replace(model, gravity=(x, y, z))


def check_drawing(show: Any, color: Any, graphics: Any, on_marker: bool) -> None:
    """Refuse a colour other than four numbers in [0, 1], and graphics where no base of its own draws them.

    Raises
    ------
    TypeError, ValueError
        Names the argument and what is allowed.
    """
    arguments.check_instance(
        "CreateTDCR", "show", show, (bool, np.bool_), "True or False", "False draws nothing."
    )
    hint = "[exudyn.graphics.Sphere(radius=0.01)] is one."
    arguments.check_instance(
        "CreateTDCR", "graphicsDataList", graphics, (list, tuple), "a list of graphics", hint
    )
    for each in graphics:
        arguments.check_instance("CreateTDCR", "graphicsDataList", each, dict, "a list of graphics", hint)
    if color is not None:
        hint = "[1, 0, 0, 1] is red; exudyn.graphics.color has others."
        arguments.check_numbers("CreateTDCR", "color", color, hint, count=4)
        if np.any((np.asarray(color) < 0.0) | (np.asarray(color) > 1.0)):
            raise ValueError(f"CreateTDCR: color = {list(color)}; must be four numbers from 0 to 1. {hint}")
    if len(graphics) and on_marker:
        raise ValueError(
            "CreateTDCR: graphicsDataList is drawn on the base of a robot on ground; with baseMarker, give it to your "
            "own body"
        )


def as_dict(handle: TDCR) -> dict[str, Any]:
    """Numbers of the items of a robot by name, and the handle itself as ``"tdcr"``."""
    return {
        "tdcr": handle,
        "nodeNumbers": handle.nNodes,
        "beamNumbers": handle.oBeams,
        "diskNumbers": handle.bDisks,
        "holeMarkers": handle.mHoles,
        "tendonNumbers": handle.oTendons,
        "forcesNumber": handle.oForces,
        "historyNodes": handle.nHistory,
        "baseJoint": handle.oBaseJoint,
        "baseMarker": handle.mBase,
        "gravityLoads": handle.lGravity,
    }
