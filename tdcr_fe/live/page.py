"""The page of a robot that is live: the 3D panel of `tdcr-fe view`, with sliders for its tendons."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from markupsafe import Markup

from tdcr_fe.live.played import Answer, PlayedRobot
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import motion_of
from tdcr_fe.report.viewer import panel
from tdcr_fe.report.viewer_data import panel_data

#: Bending angle up to which one tendon can be pulled with its slider, were there no friction [rad].
LARGEST_BEND = 2.5


def step_data(answer: Answer) -> dict[str, Any]:
    """A load step as the page reads it: picture, time, message, whether a pull ends, and whether it was made."""
    return {
        "motion": panel_data(motion_of(answer.result)),
        "milliseconds": round(1e3 * answer.seconds, 2),
        "message": answer.message,
        "settled": answer.settled,
        "made": answer.made,
    }


def ranges(played: PlayedRobot) -> list[dict[str, Any]]:
    """Of every tendon its name, and the ends of its sliders for tension [N] and displacement [m].

    A tendon at a distance r from a backbone of length L and stiffness EI bends it by T r L / EI.
    """
    robot = played.robot
    stiffness, length = robot.backbone.EI, robot.backbone.length
    found = []
    for tendon in robot.tendons:
        offset = float(np.max(np.linalg.norm(robot.hole_points(tendon)[:, :2], axis=1), initial=0.0))
        lever = max(offset, 1e-3 * length)
        found.append(
            {
                "name": tendon.name,
                "tension": _rounded(LARGEST_BEND * stiffness / (lever * length)),
                "displacement": _rounded(LARGEST_BEND * lever),
                "pretension": tendon.pretension,
            }
        )
    return found


def _rounded(value: float) -> float:
    """The number with two digits."""
    return float(f"{value:.2g}")


def live_page(played: PlayedRobot, number: int) -> str:
    """The page as HTML; it needs the server from which it comes, and nothing else.

    Parameters
    ----------
    played
        The robot, in its present state.
    number
        Of the page; a later one takes its place.
    """
    motion = motion_of(played.last.result)
    controls = {
        "page": number,
        "tendons": ranges(played),
        "places": played.places,
        "friction": played.model.friction != "none",
    }
    text = json.dumps(controls, allow_nan=False).replace("<", "\\u003c")
    return (
        environment(__package__)
        .get_template("live_page.html.j2")
        .render(name=motion.name, panel=panel(motion, "whole"), has_panel=True, controls=Markup(text))
    )
