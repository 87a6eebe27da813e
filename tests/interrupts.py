"""Processes for tests that interrupt them."""

import os
import signal
import subprocess
import sys
from typing import Any


def start_python(*arguments: str, **options: Any) -> subprocess.Popen[str]:
    """Start this Python with its own module path; Ctrl-C acts in it, also where the tests themselves ignore it.

    A shell lets the programs that it starts in the background ignore SIGINT, and programs inherit that.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    act = (lambda: signal.signal(signal.SIGINT, signal.default_int_handler)) if os.name == "posix" else None
    given = {"stdout": subprocess.PIPE, "text": True, "env": environment, **options}
    return subprocess.Popen([sys.executable, *arguments], preexec_fn=act, **given)
