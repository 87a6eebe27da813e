"""The command ``tdcr-fe``: parses arguments, prints, and turns outcomes into exit statuses. No physics.

A subcommand is a function that takes argparse's subparsers, adds its parser and sets the default ``handler``
(arguments in, exit status out). It is named in `COMMANDS`, and imports what is heavy only in its handler.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Sequence

from tdcr_fe import __version__
from tdcr_fe.commands.status import INTERRUPTED, SUCCESS, WRONG_INPUT, complain, count
from tdcr_fe.io.processes import sigterm_as_interrupt

#: Every subcommand, as ``module:function``.
COMMANDS = (
    "tdcr_fe.commands.run:add_run_parser",
    "tdcr_fe.commands.follow:add_follow_parser",
    "tdcr_fe.commands.sweep:add_sweep_parser",
    "tdcr_fe.commands.view:add_view_parser",
    "tdcr_fe.commands.demo:add_demo_parser",
    "tdcr_fe.commands.new:add_new_parser",
    "tdcr_fe.commands.identify:add_identify_parser",
    "tdcr_fe.commands.validate:add_validate_parser",
    "tdcr_fe.commands.paper:add_paper_parser",
    "tdcr_fe.commands.completion:add_completion_parser",
)

#: Mistakes in the input that are printed; of more their number is.
MOST_PROBLEMS = 40


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 done, 1 the model did not converge, 2 the input is wrong, 130 interrupted by Ctrl-C,
        143 by SIGTERM.
    """
    # Threads cost more than they gain on matrices of this size, four times on a busy machine. Numpy reads this
    # when it is first imported, which the commands do only after this line. A value set by the user is kept.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(
            errors="backslashreplace"
        )  # a label must not stop a terminal of another encoding
    with sigterm_as_interrupt() as termination:
        status = _run(argv)
    return termination.status if status == INTERRUPTED else status


def _run(argv: Sequence[str] | None) -> int:
    """Call the handler of the subcommand; errors and interruptions become exit statuses."""
    try:
        args = _parser().parse_args(argv)
        status = int(args.handler(args))
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        complain("interrupted; no results were written")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    except OSError as error:  # a disk that is full, a directory that is read-only
        complain(f"stopped: {error}")
        return WRONG_INPUT
    except Exception as error:
        from tdcr_fe.io.problems import InputError

        if not isinstance(error, InputError):
            raise
        complain(f"{count(len(error.problems), 'mistake')} in the input; nothing was written")
        for problem in error.problems[:MOST_PROBLEMS]:
            print(f"  {problem}", file=sys.stderr)
        if len(error.problems) > MOST_PROBLEMS:
            print(f"  and {len(error.problems) - MOST_PROBLEMS} more", file=sys.stderr)
        return WRONG_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tdcr-fe",
        description="Tendon-driven continuum robots in Exudyn: finite elements with Capstan friction.",
        epilog="Exit status: 0 done, 1 the model did not converge, 2 the input is wrong, 130 interrupted "
        "(143 by SIGTERM).",
    )
    parser.add_argument("--version", action="version", version=f"tdcr-fe {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for place in COMMANDS:
        module, _, function = place.partition(":")
        getattr(importlib.import_module(module), function)(commands)
    return parser
