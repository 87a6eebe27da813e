"""Worker processes end with their parent, and finished parts are kept."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from interrupts import start_python

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="lists processes by /proc")

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


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_of_validate_end_with_it(tmp_path, number):
    """e3bbe5d: after ``kill -9`` of ``validate --full`` its workers still ran 45 minutes later."""
    process = start("tdcr_fe", "validate", "--full", "-o", str(tmp_path / "out"), "--processes", "2", "-q")
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
        assert "the same command continues from there" in message


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_an_interrupted_paper_writes_its_report_and_says_unfinished(tmp_path, number, status):
    """e3bbe5d: nothing was written where the first part was not finished, and SIGTERM always ended without a report."""
    out = tmp_path / "out"
    process = start("tdcr_fe", "paper", "-o", str(out), "--no-effects")
    try:
        for _ in range(400):
            assert process.poll() is None, process.communicate()
            if out.exists():
                break
            time.sleep(0.05)
        time.sleep(1.0)  # into the first part
        process.send_signal(number)
        _, message = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == status, message
    assert "unfinished" in message
    written = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert written["interrupted"] == "figures"
    assert "Interrupted in" in (out / "report.html").read_text(encoding="utf-8")
