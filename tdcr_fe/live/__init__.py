"""A robot live: its page in a notebook or a browser of this computer; every change is a load step with its history."""

from __future__ import annotations

from tdcr_fe.callable_package import callable_package
from tdcr_fe.live.played import PlayedRobot
from tdcr_fe.live.server import LiveRobot
from tdcr_fe.model.loading import Model, SolverSettings
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import check_instance


def live(
    robot: Robot, model: Model | None = None, settings: SolverSettings | None = None, *, port: int = 0
) -> LiveRobot:
    """Open a page on which a robot answers sliders and the mouse.

    As the last line of a notebook cell it shows the page. Elsewhere, open the address ``url`` in a browser.

    Parameters
    ----------
    robot
        Description.
    model
        Model; None is the default one of the robot. An automatic mesh is not refined.
    settings
        Numerics; None resolves the path to 0.1 % of the length, for quick answers.
    port
        Port on this computer; 0 takes a free one.

    Returns
    -------
    LiveRobot
        Serves the page until it is closed.

    Raises
    ------
    OSError
        The port is in use.
    StepFailed
        The unloaded robot is not solved.
    """
    check_instance("live", "robot", robot, Robot, "a Robot. read_robot(path) reads one from robot.toml")
    return LiveRobot(PlayedRobot(robot, model or Model.default_for(robot), settings), port)


callable_package(__name__, live)
