"""A small server for one page on this computer: it answers changes of a robot, and ends when the page is closed.

It listens on the loopback address only. Every request needs the token that is in the address of the page; requests that
name another host or come from a page of another origin are rejected, so that no web site can reach it.
"""

from __future__ import annotations

import json
import secrets
import sys
import threading
import time
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs

import numpy as np

from tdcr_fe.io.write_toml import scenario_to_toml
from tdcr_fe.live.played import Answer, PlayedRobot
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import motion_of
from tdcr_fe.report.viewer import panel, panel_data

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
    """For every tendon its name, and the ends of its sliders for tension [N] and displacement [m].

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
        Number of the page; a later one takes its place.
    """
    motion = motion_of(played.last.result)
    controls = {
        "page": number,
        "tendons": ranges(played),
        "places": played.places,
        "friction": played.model.friction != "none",
    }
    template = environment(__package__).get_template("live_page.html.j2")
    return template.render(name=motion.name, panel=panel(motion, "whole"), has_panel=True, controls=controls)


# ------------------------------------------------------------------------------------------------------------ server

#: Height of the page in a notebook [pixels].
HEIGHT = 860
#: Largest message [bytes]; a change has some hundred.
LARGEST_MESSAGE = 65_536
#: Seconds between signs of life on the connection by which server and page notice that the other has ended.
SIGN_OF_LIFE = 0.5
#: In place of the number of the newest page, where the server is closed.
CLOSED = -1
#: Seconds in which a page that is loaded again takes the place of the one before.
RELOAD = 3.0


class LiveRobot(ThreadingHTTPServer):
    """A robot whose page is served in the background, on the loopback address; made by `tdcr_fe.live`.

    Parameters
    ----------
    played
        The robot.
    port
        Port on this computer; 0 takes a free one.
    robot_file
        Name of the robot's file in a saved ``scenario.toml``.

    Raises
    ------
    OSError
        The port is in use.
    """

    daemon_threads = True

    def __init__(self, played: PlayedRobot, port: int = 0, robot_file: str = "robot.toml") -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.played, self.robot_file = played, robot_file
        self.token = secrets.token_urlsafe(24)
        self.page = 0  # number of the newest page; those before it have ended
        self.solving = threading.Lock()  # held while a load step is solved
        self.closed_at: float | None = None  # when the newest page was closed [s], of `time.monotonic`
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page; whoever knows it can use the page, on this computer only."""
        return f"http://127.0.0.1:{self.server_port}/?token={self.token}"

    @property
    def steps(self) -> tuple[LoadStep, ...]:
        """The loading sequence so far, for `tdcr_fe.simulate`."""
        return tuple(self.played.steps)

    def scenario(self) -> str:
        """The loading sequence so far as the text of a ``scenario.toml``."""
        played = self.played
        return scenario_to_toml(played.model, played.steps, self.robot_file, played.settings)

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'

    def close(self) -> None:
        """End the connections to all pages, and the server; the page stays as it is."""
        self.page = CLOSED
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print what failed; a page that is closed before it is answered is no failure."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)

    def wait_until_closed(self) -> None:
        """Return when the page has been opened and closed again."""
        while self.closed_at is None or time.monotonic() - self.closed_at < RELOAD:
            time.sleep(0.1)


class _Handler(BaseHTTPRequestHandler):
    """One connection; its methods are named for the requests that they answer."""

    server: LiveRobot
    protocol_version = "HTTP/1.1"
    timeout = 60.0  # of an idle connection [s]

    def do_GET(self) -> None:
        """The page, the connection by which it notices the end of the server, or the sequence as a file."""
        path, query = self._checked()
        if path is None:
            return
        if path == "/":
            self.server.page += 1
            self.server.closed_at = None
            with self.server.solving:
                text = live_page(self.server.played, self.server.page)
            self._send(text, "text/html")
        elif path == "/alive":
            self._stay(query.get("page", ""))
        elif path == "/scenario.toml":
            with self.server.solving:
                text = self.server.scenario()
            self._send(text, "text/plain", Content_Disposition='attachment; filename="scenario.toml"')
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"there is nothing at {path[:80]}")

    def do_POST(self) -> None:
        """A change of the robot: one load step."""
        path, query = self._checked()
        if path is None:
            return
        if path != "/change":
            return self._refuse(HTTPStatus.NOT_FOUND, f"there is nothing at {path[:80]}")
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal():
            return self._refuse(HTTPStatus.LENGTH_REQUIRED, "the length of the message is missing")
        if len(length) > 9 or int(length) > LARGEST_MESSAGE:
            text = f"a message has at most {LARGEST_MESSAGE} bytes"
            return self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
        body = self.rfile.read(int(length))
        if query.get("page") != str(self.server.page):
            return self._refuse(
                HTTPStatus.CONFLICT, "the robot was opened in another page; this one has ended"
            )
        try:
            with self.server.solving:
                text = json.dumps(step_data(answer_to(json.loads(body), self.server.played)), allow_nan=False)
        except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
            return self._refuse(HTTPStatus.BAD_REQUEST, f"not a change of this robot: {error}")
        return self._send(text, "application/json")

    def _checked(self) -> tuple[str | None, dict[str, str]]:
        """Path and query of a request that may be answered; None where it was rejected."""
        path, _, text = self.path.partition("?")
        query = {k: v[-1] for k, v in parse_qs(text).items()}
        hosts = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in hosts:
            self._refuse(HTTPStatus.FORBIDDEN, "this server answers on the loopback address only")
        elif origin is not None and origin not in {f"http://{host}" for host in hosts}:
            self._refuse(HTTPStatus.FORBIDDEN, "requests of other pages are rejected")
        elif not secrets.compare_digest(query.get("token", "").encode(), self.server.token.encode()):
            self._refuse(
                HTTPStatus.FORBIDDEN, "the token is missing or wrong; use the address that was printed"
            )
        else:
            return path, query
        return None, query

    def _stay(self, page: str) -> None:
        """Keep the connection to a page until one side ends; the last page that is closed ends the server."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Connection", "close")
        self.end_headers()
        try:
            while page == str(self.server.page):
                self.wfile.write(b":\n\n")
                time.sleep(SIGN_OF_LIFE)
            if self.server.page != CLOSED:
                self.wfile.write(b"event: replaced\ndata: \n\n")
        except OSError:  # the page is gone
            if page == str(self.server.page):
                self.server.closed_at = time.monotonic()

    def _send(self, text: str, kind: str, status: HTTPStatus = HTTPStatus.OK, **headers: str) -> None:
        """Answer with a text; a ``_`` in the name of a header stands for a ``-``."""
        body = text.encode()
        self.send_response(status)
        headers |= {
            "Content_Type": f"{kind}; charset=utf-8",
            "Content_Length": str(len(body)),
            "Cache_Control": "no-store",
            "Referrer_Policy": "no-referrer",
            "X_Content_Type_Options": "nosniff",
        }
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Answer with a sentence and close the connection, without reading what else was sent."""
        self._send(text, "text/plain", status, Connection="close")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is printed for a request."""


def answer_to(message: Mapping[str, Any], played: PlayedRobot) -> Answer:
    """Make the change that a page asks for.

    Parameters
    ----------
    message
        Has one of the keys ``drive`` (``tensions`` and ``displacements`` by tendon), ``pull`` (``place`` and ``to``),
        ``let_go``, ``friction`` (true or false) and ``restart``.
    played
        The robot.

    Raises
    ------
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError
        It is none of them, or a value is not allowed.
    """
    ((kind, value),) = message.items()
    if kind == "drive":
        return played.drive(value.get("tensions", {}), value.get("displacements", {}))
    if kind == "pull":
        x, y, z = (float(v) for v in value["to"])
        return played.pull(int(value["place"]), (x, y, z))
    if kind == "friction" and isinstance(value, bool):
        return played.switch_friction(value)
    if kind == "let_go":
        return played.let_go()
    if kind == "restart":
        return played.restart()
    raise ValueError(f"{str(kind)[:40]!r} is none of drive, pull, let_go, friction, restart")
