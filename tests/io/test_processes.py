"""Worker processes end with their parent; records of many cases are kept as they are found, and recalled."""

import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
from interrupts import start_python

from tdcr_fe.io.files import OtherHead
from tdcr_fe.io.processes import interruption_deferred, worker_pool
from tdcr_fe.validation.records import Records

#: Time that workers may take to end after their parent [s].
LIMIT = 20.0


def test_ctrl_c_waits_for_the_end_of_a_block():
    """A library that draws made a ValueError of it."""
    done, before = [], signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), interruption_deferred():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)
            done.append(True)
        assert done and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


PARENT = """
import os, sys, time
from tdcr_fe.io.processes import sigterm_as_interrupt, worker_pool

def main():
    with sigterm_as_interrupt() as sigterm:
        try:
            with worker_pool(2) as pool:
                print(*{f.result() for f in [pool.submit(os.getpid) for _ in range(40)]}, flush=True)
                time.sleep(60.0)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
            return 143 if sigterm else 130
    return 0

if __name__ == "__main__":
    sys.exit(main())
"""


def alive(pid):
    """Whether a process runs; a zombie does not."""
    stat = Path(f"/proc/{pid}/stat")
    try:
        os.kill(pid, 0)
        return not (stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] == "Z")
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_for_end(pids):
    """Wait until all processes are gone."""
    begun = time.perf_counter()
    while any(alive(p) for p in pids):
        assert time.perf_counter() - begun < LIMIT, f"{[p for p in pids if alive(p)]} still run"
        time.sleep(0.02)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("number", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_workers_end_with_their_parent(tmp_path, number):
    """e3bbe5d: after ``kill -9`` workers kept running without limit."""
    (tmp_path / "parent.py").write_text(PARENT)
    process = start_python(str(tmp_path / "parent.py"))
    workers = [int(p) for p in process.stdout.readline().split()]
    try:
        assert workers and all(alive(p) for p in workers)
        process.send_signal(getattr(signal, number))
        wait_for_end(workers)
        output = process.communicate(timeout=10)[0]
    finally:
        process.kill()
    assert process.returncode == {"SIGKILL": -9, "SIGTERM": 143, "SIGINT": 130}[number]
    assert ("interrupted" in output) == (number != "SIGKILL")


def test_an_interruption_ends_busy_workers_at_once():
    with pytest.raises(KeyboardInterrupt), worker_pool(1) as pool:
        worker = pool.submit(os.getpid).result()
        future = pool.submit(time.sleep, 60.0)
        while not future.running():
            time.sleep(0.01)
        begun = time.perf_counter()
        raise KeyboardInterrupt
    assert time.perf_counter() - begun < LIMIT
    assert isinstance(future.exception(), BrokenProcessPool)
    if os.name == "posix":
        wait_for_end([worker])


def test_workers_use_one_thread():
    with worker_pool(1) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"


# ------------------------------------------------------------ store


HEAD = {"source": "abc", "n": 3}


def test_a_line_that_a_kill_cut_off_is_removed(tmp_path):
    store = Records(tmp_path / "r.jsonl", HEAD)
    store.begin()
    store.keep("1", {"square": 1})
    whole = store.path.read_bytes()
    for rest in (b'{"key": "2", "squ', b'{"key": "2", "square": 4}'):
        store.path.write_bytes(whole + rest)
        assert list(store.recall(["1", "2"])) == [("1", {"square": 1})]
        assert store.path.read_bytes() == whole


def test_what_has_no_head_is_not_touched(tmp_path):
    path = tmp_path / "r.jsonl"
    path.write_text("no head\n")
    with pytest.raises(OtherHead, match="does not begin with a head"):
        Records(path, HEAD).begin()
    assert path.read_text() == "no head\n"
