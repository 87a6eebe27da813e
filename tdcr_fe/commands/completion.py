"""The command ``tdcr-fe completion``: a script with which the shell completes commands, options and their values."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tdcr_fe.commands.status import SUCCESS

_SCRIPT = """\
# Completion of tdcr-fe. Put this into the start file of your shell:
#   eval "$(tdcr-fe completion {shell})"
{first}_tdcr_fe() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} words=""
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands} --help --version" -- "$current"))
        return
    fi
    case "${{COMP_WORDS[1]}} $before" in
{values}
    esac
    if [ -z "$words" ]; then
        case "$current" in
        -*)
            case "${{COMP_WORDS[1]}}" in
{options}
            esac
            ;;
        esac
    fi
    if [ -n "$words" ]; then
        COMPREPLY=($(compgen -W "$words" -- "$current"))
    else
        COMPREPLY=($(compgen -f -- "$current"))
    fi
}}
complete -o filenames -F _tdcr_fe tdcr-fe
"""


def add_completion_parser(commands: Any) -> None:
    """Add ``tdcr-fe completion``."""
    parser = commands.add_parser(
        "completion",
        help="print a script with which the shell completes commands and options",
        description="Print a script that completes commands, options, their values and file names. Put "
        'eval "$(tdcr-fe completion bash)" into ~/.bashrc, or eval "$(tdcr-fe completion zsh)" into ~/.zshrc.',
    )
    parser.add_argument("shell", choices=("bash", "zsh"), help="the shell")
    parser.set_defaults(handler=completion, parsers=commands.choices)


def completion(args: argparse.Namespace) -> int:
    """Print the script."""
    print(script(args.shell, args.parsers), end="")
    return SUCCESS


def script(shell: str, parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """The script for a shell.

    Parameters
    ----------
    shell
        "bash", or "zsh", which takes scripts of bash after ``bashcompinit``.
    parsers
        Parser of every command, by its name.
    """
    values, options = [], []
    for name, parser in parsers.items():
        known = []
        for action in parser._actions:
            known += [o for o in action.option_strings if o.startswith("--")]
            if action.choices is not None:
                words = " ".join(map(str, action.choices))
                # What comes before the value: an option, or for an argument the command itself.
                before = [f'"{name} {o}"' for o in action.option_strings or [name]]
                values.append(f'    {" | ".join(before)}) words="{words}" ;;')
        options.append(f'            {name}) words="{" ".join(known)}" ;;')
    first = "autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    return _SCRIPT.format(
        shell=shell,
        first=first,
        commands=" ".join(parsers),
        values="\n".join(values),
        options="\n".join(options),
    )
