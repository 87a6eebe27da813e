"""Commands for other programs: schemas of the input files for editors, completion for shells."""

from __future__ import annotations

import argparse
import json

from tdcr_fe.commands.common import Exit
from tdcr_fe.io.problems import refusal


def schema(args: argparse.Namespace) -> int:
    """Print the schema of an input file."""
    from tdcr_fe.io.keys import json_schema
    from tdcr_fe.sweeps.read import (
        sweep_schema,  # imports Exudyn, which the completion of a shell does not need
    )

    schema_of_file = sweep_schema() if args.file == "sweep" else json_schema(args.file)
    print(json.dumps(schema_of_file, indent=2, ensure_ascii=False))
    return Exit.DONE


def completion(args: argparse.Namespace) -> int:
    """Print the script that shtab makes of the parsers.

    Raises
    ------
    InputError
        shtab is not installed.
    """
    try:
        import shtab
    except ImportError as error:
        text = "needs shtab, which is not installed: pip install 'tdcr-fe[completion]'"
        raise refusal("completion", text, value=args.shell) from error
    for parser in args.commands.values():
        for action in parser._actions:
            if action.choices is None and action.nargs != 0:
                action.complete = shtab.FILE
    print(shtab.complete(args.program, args.shell))
    return Exit.DONE
