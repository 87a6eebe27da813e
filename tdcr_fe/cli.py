"""The command ``tdcr-fe``: parses arguments, prints, and turns outcomes into exit statuses. No physics.

The commands are those of `tdcr_fe.commands.common`; the module of one is imported when it is called.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

from tdcr_fe import __version__
from tdcr_fe.commands.common import COMMANDS, Exit, Noted, complain, stdout_kept_free
from tdcr_fe.io.files import InputError, Problem, to_json
from tdcr_fe.io.processes import sigterm_as_interrupt
from tdcr_fe.model.messages import count, meant, warnings_to

INTERRUPTED = "130 interrupted (143 by SIGTERM), what was found until then is written"
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
        Exit status: 0 done, 1 the model did not converge or nothing could be written, 2 the input is wrong, 130
        interrupted by Ctrl-C, 143 by SIGTERM.
    """
    # Threads cost more than they gain on matrices of this size, four times on a busy machine. Numpy reads this
    # when it is first imported, which the commands do only after this line. A value set by the user is kept.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A label must not stop a terminal of another encoding.
        sys.stdout.reconfigure(errors="backslashreplace")
    given = list(sys.argv[1:] if argv is None else argv)
    noted, command = Noted(), ""
    try:
        args, others = _parser().parse_known_args(given)
        if others:
            args.parser.error(f"unrecognized arguments: {' '.join(others)}")
        args.noted, command = noted, args.command
        with sigterm_as_interrupt() as sigterm, stdout_kept_free(args), warnings_to(noted.warn):
            noted.quiet = getattr(args, "quiet", False)
            status = _run(args)
    except WrongArguments as error:
        error.parser.print_usage(sys.stderr)
        message = f"{error}{_meant(error, given)}"
        print(f"{error.parser.prog}: error: {message}", file=sys.stderr)
        if "--json" in given:
            noted.errors, noted.message = [Problem("arguments", "", "", message)], message
            _print_json(noted, command, Exit.WRONG_INPUT)
        raise SystemExit(Exit.WRONG_INPUT) from None
    status = Exit.TERMINATED if sigterm and status == Exit.INTERRUPTED else status
    if getattr(args, "json", False):
        _print_json(noted, command, status)
    return status


class WrongArguments(Exception):
    """The arguments of the command are wrong.

    Attributes
    ----------
    parser : argparse.ArgumentParser
        That found it.
    """

    def __init__(self, parser: argparse.ArgumentParser, message: str) -> None:
        self.parser = parser
        super().__init__(message)


class _Parser(argparse.ArgumentParser):
    """Parser whose errors are exceptions, so that they can be printed as JSON."""

    def error(self, message: str) -> NoReturn:
        """Raise `WrongArguments`."""
        raise WrongArguments(self, message)


def _meant(error: WrongArguments, given: Sequence[str]) -> str:
    """The nearest of what there is, for a choice that is misspelt or options that there are not."""
    if wrong := re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", str(error)):
        return meant(wrong[1], re.findall(r"[\w-]+", wrong[2]))
    known = re.findall(r"--[\w-]+", error.parser.format_help())
    flags = [word.partition("=")[0] for word in given if word.startswith("--")]
    unknown = [flag for flag in flags if not any(option.startswith(flag) for option in known)]
    return "".join(f"; there is no option {flag}{meant(flag, known)}" for flag in unknown)


class _Formatter(argparse.HelpFormatter):
    """Keeps the lines of the examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        return "\n".join(x if x.startswith(" ") else fill(x, width, indent) for x in text.split("\n"))


def _run(args: argparse.Namespace) -> int:
    """Call the handler of the subcommand; errors and interruptions become exit statuses."""
    try:
        module, _, function = COMMANDS[args.command].handler.partition(":")
        status = int(getattr(importlib.import_module(module), function)(args))
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        text = "interrupted; no results were written"
        return _ended(args, Exit.INTERRUPTED, text.replace("no", "no further") if args.noted.files else text)
    except BrokenPipeError:  # the reader of the output was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.DONE
    except OSError as error:  # a disk that is full, a directory that is read-only
        return _ended(args, Exit.FAILED, f"stopped: {error.strerror or error}: {error.filename or 'output'}")
    except InputError as error:
        args.noted.errors = error.problems
        complain(f"{count(len(error.problems), 'mistake')} in the input; nothing was written")
        for problem in error.problems[:MOST_PROBLEMS]:
            print(f"  {problem}", file=sys.stderr)
        if len(error.problems) > MOST_PROBLEMS:
            print(f"  and {len(error.problems) - MOST_PROBLEMS} more", file=sys.stderr)
        return Exit.WRONG_INPUT


def _ended(args: argparse.Namespace, status: int, message: str) -> int:
    complain(message)
    args.noted.message = message
    return status


def _print_json(noted: Noted, command: str, status: int) -> None:
    print(to_json(noted.document(command, status)), end="", flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="tdcr-fe",
        description="Tendon-driven continuum robots in Exudyn: finite elements with Capstan friction.",
        epilog="Exit status: 0 done; 1 the model did not converge, or nothing could be written; 2 the input is wrong; "
        f"{INTERRUPTED}.",
    )
    parser.add_argument("--version", action="version", version=f"tdcr-fe {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)
    for name, command in COMMANDS.items():
        epilog = "\n  ".join(["Examples:", *(f"tdcr-fe {example}" for example in command.examples)])
        if command.failure:
            epilog += f"\n\nExit status: 0 done; 1 {command.failure}; 2 the input is wrong; {INTERRUPTED}."
        sub = commands.add_parser(
            name,
            help=command.help,
            description=command.description,
            epilog=epilog,
            formatter_class=_Formatter,
        )
        for names, options in command.parsed_arguments():
            sub.add_argument(*names, **options)
        sub.set_defaults(parser=sub)
    return parser
