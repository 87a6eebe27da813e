"""The server of a live page answers its page only, and says why it rejects what it does."""

import http.client
import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from inputs import write
from robots import three

import tdcr_fe as tdcr
from tdcr_fe.cli import main
from tdcr_fe.live.played import SETTINGS
from tdcr_fe.live.server import LARGEST_MESSAGE, LiveRobot


@pytest.fixture
def served() -> Iterator[tdcr.LiveRobot]:
    robot = tdcr.live(three(), tdcr.Model(elements_per_bay=1))
    yield robot
    robot.close()


def ask(served: tdcr.LiveRobot, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, str]:
    """Status and text of a reply."""
    connection = http.client.HTTPConnection("127.0.0.1", served.server_port, timeout=20)
    connection.request(method, path, body, {k.replace("_", "-"): v for k, v in headers.items()})
    reply = connection.getresponse()
    text = reply.read().decode()
    connection.close()
    return reply.status, text


def head(served: tdcr.LiveRobot, request: str, page: int) -> bytes:
    """The first lines of a request that is sent by hand."""
    path = f"{request}?token={served.token}&page={page}"
    return f"{path} HTTP/1.1\r\nHost: 127.0.0.1:{served.server_port}\r\n".encode()


def change(served: tdcr.LiveRobot, message: object) -> tuple[int, str]:
    path = f"/change?token={served.token}&page={served.page}"
    return ask(served, "POST", path, json.dumps(message).encode())


def test_page_changes_and_scenario(served, tmp_path):
    status, page = ask(served, "GET", f"/?token={served.token}")
    assert status == 200 and 'class="robot-view"' in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    status, text = change(served, {"drive": {"tensions": {"t1": 1.5}}})
    assert status == 200
    motion = json.loads(text)["motion"]
    steps = [tdcr.LoadStep(tensions={"t1": 1.5})]
    (expected,) = tdcr.simulate(three(), tdcr.Model(elements_per_bay=1), steps).steps
    assert motion["bending"][0] == pytest.approx(57.29578 * expected.bending_angle, abs=1e-3)
    status, scenario = ask(served, "GET", f"/scenario.toml?token={served.token}")
    read = tdcr.read_scenario(write(tmp_path, tdcr.robot_to_toml(three()), scenario))
    assert list(read.steps) == list(served.steps) and read.model == served.played.model


def test_strangers_are_rejected(served):
    """No token, a wrong one, another host (DNS rebinding), another origin, a path outside, another method."""
    token, port = served.token, served.server_port
    good, steps = f"/?token={token}", served.steps
    message = json.dumps({"drive": {"tensions": {"t1": 1.0}}}).encode()
    post = f"/change?token={token}&page=0"
    for (status, text), wanted in [
        (ask(served, "GET", "/"), 403),
        (ask(served, "GET", "/?token=" + "x" * 32), 403),
        (ask(served, "GET", "/?token=%C3%A9"), 403),
        (ask(served, "GET", good, Host=f"evil.example:{port}"), 403),
        (ask(served, "GET", good, Origin="http://evil.example"), 403),
        (ask(served, "POST", post, message, Origin="null"), 403),
        (ask(served, "GET", f"/../../etc/passwd?token={token}"), 404),
        (ask(served, "GET", f"/%2e%2e/robot.toml?token={token}"), 404),
        (ask(served, "POST", f"/?token={token}", message), 404),
        (ask(served, "PUT", good, message), 501),
        (ask(served, "GET", f"HTTP://[{good}"), 404),
    ]:
        assert status == wanted and text
    assert served.steps == steps


@pytest.mark.parametrize("length", ["10000000", "9" * 5000])
def test_a_message_of_ten_megabytes_is_not_read(served, length):
    """It is rejected by its length, before its body is sent; one of more than 4300 digits printed a traceback."""
    with socket.create_connection(("127.0.0.1", served.server_port), timeout=10) as link:
        link.sendall(head(served, "POST /change", 0) + f"Content-Length: {length}\r\n\r\n".encode())
        reply = b""
        while chunk := link.recv(4096):
            reply += chunk
    assert b" 413 " in reply and str(LARGEST_MESSAGE).encode() in reply


def test_broken_messages_are_named_and_change_nothing(served):
    both = {"tensions": {"t1": 1.0}, "displacements": {"t1": 1e-3}}
    drives = [None, True, 1e999, "t1", [1, 2], {"tensions": 3}, both]
    drives += [{"tensions": {name: x}} for name, x in (("t1", "much"), ("t1", -2.0), ("t9", 1.0))]
    pulls = [None, {}, {"to": [0, 0]}, {"place": 99, "to": [0, 0, 1]}, {"place": 1e999, "to": [0, 0, 1]}]
    pulls += [{"place": 1, "to": [x, 0, 0]} for x in ("a", 1e999)]
    wrong = [("drive", x) for x in drives] + [("pull", x) for x in pulls]
    wrong += [(kind, 1.0) for kind in ("friction", "", "quit", "__class__")]
    steps = served.steps
    for kind, value in wrong:
        status, text = change(served, {kind: value})
        assert status == 400 and text.startswith("not a change of this robot"), (kind, value)
    path = f"/change?token={served.token}&page={served.page}"
    for body in (b"", b"{", b"[" * 20_000, b"\xff\xfe", b"[1, 2]", b'{"a": 1, "b": 2}'):
        assert ask(served, "POST", path, body)[0] == 400
    assert served.steps == steps


@contextmanager
def page_alive(served: tdcr.LiveRobot, page: int) -> Iterator[socket.socket]:
    """The connection that an open page keeps."""
    with socket.create_connection(("127.0.0.1", served.server_port), timeout=10) as link:
        link.sendall(head(served, "GET /alive", page) + b"\r\n")
        assert b" 200 " in link.recv(4096)
        yield link


def test_a_second_page_takes_the_place_of_the_first(served):
    good = f"/?token={served.token}"
    ask(served, "GET", good)
    with page_alive(served, 1) as first:
        ask(served, "GET", good)
        text = b""
        while b"replaced" not in text:
            text += first.recv(4096)
    status, text = ask(served, "POST", f"/change?token={served.token}&page=1", b'{"let_go": true}')
    assert status == 409 and "another page" in text
    assert change(served, {"let_go": True})[0] == 200


def test_the_server_ends_with_its_page_and_the_page_with_its_server(served):
    ask(served, "GET", f"/?token={served.token}")
    ended = threading.Thread(target=served.wait_until_closed, daemon=True)
    ended.start()
    with page_alive(served, 1):
        time.sleep(0.3)
        assert ended.is_alive()
    ended.join(20.0)
    assert not ended.is_alive()


def test_changes_from_many_threads_are_taken_one_by_one(served):
    ask(served, "GET", f"/?token={served.token}")
    before = len(served.steps)
    changes = [{"drive": {"tensions": {"t2": 0.1 * k}}} for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        replies = list(pool.map(lambda each: change(served, each), changes))
    assert [status for status, _ in replies] == [200] * 8 and len(served.steps) == before + 8


def test_a_page_that_is_gone_before_it_is_answered_is_not_a_failure(served, capfd):
    """Closed while its load step is solved, it left a traceback in the terminal."""
    with served.solving, socket.create_connection(("127.0.0.1", served.server_port)) as page:
        body = b'{"let_go": null}'
        page.sendall(head(served, "POST /change", 0) + b"Content-Length: %d\r\n\r\n" % len(body) + body)
        page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        time.sleep(0.2)
    change(served, {"let_go": None})  # the one before has ended
    time.sleep(0.1)
    assert capfd.readouterr().err == ""


def live(folder, robot, model):
    """Exit status of the command."""
    (folder / "robot.toml").write_text(tdcr.robot_to_toml(robot))
    (folder / "model.toml").write_text(model)
    files = [str(folder / "robot.toml"), "--model", str(folder / "model.toml")]
    return main(["live", *files, "--no-browser", "-q"])


def test_an_unloaded_robot_that_is_not_solved_ends_the_command(tmp_path, capsys):
    """Heavy disks, and a single iteration; it ended with a traceback."""
    model = "[model]\ngravity = [0.0, 9.81, 0.0]\n[solver]\nmax_iterations = 1\nmin_substep = 1.0\n"
    assert live(tmp_path, three().with_disks(mass=1e-3), model) == 1
    assert "the unloaded robot is not solved" in capsys.readouterr().err


@pytest.mark.parametrize(("table", "expected"), [("", SETTINGS), ("[solver]\ntolerance = 1e-7\n", 1e-7)])
def test_the_command_takes_numerics_of_a_picture_where_none_are_given(
    table, expected, tmp_path, monkeypatch, capsys
):
    """It took those of `run`: while a robot was dragged by steps of 1 cm, half of its load steps ran out of time."""
    taken = []
    monkeypatch.setattr(LiveRobot, "wait_until_closed", lambda self: taken.append(self.played.settings))
    assert live(tmp_path, three(), "[model]\nelements_per_bay = 1\n" + table) == 0
    assert taken == [SETTINGS] if expected is SETTINGS else taken[0].tolerance == expected
    assert "?token=" in capsys.readouterr().out  # with -q it did not say where it is
