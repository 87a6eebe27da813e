"""Worker processes end with their parent, and finished parts are kept."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from interrupts import start_python

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="lists processes by /proc"),
]

#: Time that workers may take to end after their parent [s].
LIMIT = 20.0


def start(*arguments):
    return start_python("-m", *arguments, stderr=subprocess.PIPE)


def descendants(pid):
    """Processes started by a process, and by those, with their command lines."""
    found = {}
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            try:
                found[child] = Path(f"/proc/{child}/cmdline").read_text().replace("\0", " ")
            except OSError:
                continue
            found |= descendants(child)
    return found


def runs(pid):
    """Whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


def wait_for_workers(process, count):
    """Pids of all descendants, once ``count`` workers are there."""
    for _ in range(400):
        assert process.poll() is None, process.communicate()
        found = descendants(process.pid)
        if sum("spawn_main" in line for line in found.values()) >= count:
            return list(found)
        time.sleep(0.05)
    raise AssertionError("no workers were started")


VALIDATE = ("tdcr_fe", "validate", "--full", "-q")
CAMPAIGN = ("tdcr_fe.validation", "random_robots")


@pytest.mark.parametrize(
    ("command", "number"),
    [
        (VALIDATE, signal.SIGKILL),
        (VALIDATE, signal.SIGINT),
        (CAMPAIGN, signal.SIGTERM),
        (CAMPAIGN, signal.SIGINT),
    ],
)
def test_workers_end_with_their_parent(tmp_path, command, number):
    """e3bbe5d: after ``kill -9`` of ``validate --full`` its workers still ran 45 minutes later."""
    process = start(*command, "-o", str(tmp_path / "out"), "--processes", "2")
    workers = []
    try:
        workers = wait_for_workers(process, 2)
        process.send_signal(number)
        _, message = process.communicate(timeout=15)
        begun = time.perf_counter()
        while any(runs(w) for w in workers):
            assert time.perf_counter() - begun < LIMIT
            time.sleep(0.05)
    finally:
        for pid in [process.pid, *workers]:
            if runs(pid):
                os.kill(pid, signal.SIGKILL)
    expected = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
    assert process.returncode == expected[number]
    if number != signal.SIGKILL:
        assert (
            "the same command continues from there" if command == VALIDATE else "start it again to resume"
        ) in message
