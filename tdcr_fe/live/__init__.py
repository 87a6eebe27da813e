"""A robot live: its page in a notebook or a browser of this computer; every change is a load step with its history."""

from __future__ import annotations

import threading

from tdcr_fe.callable_package import callable_package
from tdcr_fe.io.write_toml import scenario_to_toml
from tdcr_fe.live.played import PlayedRobot
from tdcr_fe.live.server import LiveServer
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import check_instance

#: Height of the page in a notebook [pixels].
HEIGHT = 860


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


class LiveRobot:
    """A robot whose page is served in the background; made by `live`.

    Parameters
    ----------
    played
        The robot.
    port
        Port on this computer; 0 takes a free one.
    robot_file
        Name of the robot's file in a saved ``scenario.toml``.

    Attributes
    ----------
    server : LiveServer
    """

    def __init__(self, played: PlayedRobot, port: int = 0, robot_file: str = "robot.toml") -> None:
        self._played, self._robot_file = played, robot_file
        self.server = LiveServer(played, port, self.scenario)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page; whoever knows it can use the page, on this computer only."""
        return self.server.url

    @property
    def steps(self) -> tuple[LoadStep, ...]:
        """The loading sequence so far, for `tdcr_fe.simulate`."""
        return tuple(self._played.steps)

    def scenario(self) -> str:
        """The loading sequence so far as the text of a ``scenario.toml``."""
        return scenario_to_toml(
            self._played.model, self._played.steps, self._robot_file, self._played.settings
        )

    def close(self) -> None:
        """End the server; the page stays as it is."""
        self.server.close()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'


callable_package(__name__, live)
