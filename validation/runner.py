"""The runner of all campaigns: command line, worker processes, resuming, tables and pages.

A campaign is a module of `tdcr_fe.validation.campaigns` with a subclass of `Campaign` as its ``CAMPAIGN``. The first
line of its text is its description in the list.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache, partial
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from tdcr_fe.io.files import InputError, OtherHead, check_output_folder, plain, write_text
from tdcr_fe.io.processes import sigterm_as_interrupt
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.messages import count
from tdcr_fe.validation.records import Record, Records

if TYPE_CHECKING:
    import pandas as pd

PROGRAM = "python -m tdcr_fe.validation"


class Campaign:
    """Many cases, what is done with each, and what follows from all outcomes.

    A subclass has `outcome` and `run`, and whatever differs from the defaults.
    """

    #: What a case is called.
    unit: ClassVar[str] = "robot"
    #: Default of ``-n``, for cases that are drawn by a seed; None for a fixed list of cases.
    count: ClassVar[int | None] = None
    #: Dataclass of an outcome; its fields hold what JSON has (numbers that are not finite become None), and it has
    #: ``passed``.
    outcome: ClassVar[Any]

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Add options beyond those that all campaigns have."""

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """Cases by key, in the order of the table; those of a seed are drawn by `run`.

        Raises
        ------
        ValueError
            An option is wrong.
        """
        return {str(seed): seed for seed in range(options.first, options.first + options.n)}

    def prepare(self, out: Path) -> None:
        """Write what all cases need into the folder of the results."""

    def run(self, case: Any, out: Path) -> Any:
        """The outcome of a case, in a worker process; files of its own may go to ``out``."""
        raise NotImplementedError

    def row(self, outcome: Any) -> dict[str, Any]:
        """Row of an outcome in the table of all cases."""
        return {k: " | ".join(map(str, v)) if isinstance(v, list) else v for k, v in vars(outcome).items()}

    def table(self, outcomes: Sequence[Any]) -> pd.DataFrame:
        """One row a case."""
        import pandas as pd

        return pd.DataFrame([self.row(o) for o in outcomes])

    def report(self, outcomes: Sequence[Any]) -> list[str | pd.DataFrame]:
        """Sentences and tables, which are printed and written as a page."""
        good = sum(o.passed for o in outcomes)
        return [self.table(outcomes), f"{good} of {count(len(outcomes), self.unit)} passed"]

    def passed(self, outcomes: Sequence[Any]) -> bool:
        """Whether the campaign passes."""
        return all(o.passed for o in outcomes)

    def write(self, outcomes: Sequence[Any], out: Path) -> None:
        """Write further files, such as pictures."""


def names() -> list[str]:
    """Names of all campaigns."""
    folder = files("tdcr_fe.validation.campaigns").iterdir()
    return sorted(f.name.removesuffix(".py") for f in folder if f.name.endswith(".py") and f.name[0] != "_")


def load(name: str) -> Campaign:
    """The campaign of this name."""
    return import_module(f"tdcr_fe.validation.campaigns.{name}").CAMPAIGN


def _text(name: str) -> str:
    """What a campaign's module says of itself; nothing is imported for it."""
    source = files("tdcr_fe.validation.campaigns").joinpath(f"{name}.py").read_text(encoding="utf-8")
    return ast.get_docstring(ast.parse(source)) or ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a campaign by its name, or list all of them.

    Parameters
    ----------
    argv
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        Exit status: 0 passed, 1 not passed, 2 the input is wrong, 130 interrupted, 143 by SIGTERM (start it again to
        resume).
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: {PROGRAM} NAME -o OUT [options]; {PROGRAM} NAME --help\n\ncampaigns:")
        for name in names():
            print(f"  {name:<16} {_text(name).partition(chr(10))[0]}")
        return 0
    name, *rest = arguments
    if name not in names():
        near = difflib.get_close_matches(name, names(), 1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(names())}"
        print(f"no campaign {name!r}; {hint}", file=sys.stderr)
        return 2
    campaign = load(name)
    parser = _parser(name, campaign)
    options = parser.parse_args(rest)
    if min(options.processes, getattr(options, "n", 1)) < 1 or getattr(options, "first", 0) < 0:
        parser.error("-n and --processes must be at least 1, --first at least 0")
    try:
        check_output_folder(options.o)
        cases = campaign.cases(options)
        if options.only:
            unknown = [key for key in options.only if key not in cases]
            if unknown:
                raise ValueError(f"--only: no case {unknown[0]!r}; there are {', '.join(cases)}")
            cases = {key: cases[key] for key in cases if key in options.only}
        return _work(name, campaign, cases, options)
    except (InputError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2


def _parser(name: str, campaign: Campaign) -> argparse.ArgumentParser:
    ends = "Exit status: 0 passed, 1 not passed, 2 wrong input, 130 interrupted, 143 by SIGTERM."
    program, raw = f"{PROGRAM} {name}", argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(program, description=_text(name), epilog=ends, formatter_class=raw)
    unit = campaign.unit
    if campaign.count is not None:
        default = campaign.count
        parser.add_argument("-n", type=int, default=default, metavar="COUNT", help=f"{unit}s ({default})")
        parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (0)")
    parser.add_argument("-o", required=True, type=Path, metavar="OUT", help="folder of the results")
    parser.add_argument("--only", nargs="+", metavar="KEY", help=f"only these {unit}s, by seed or name")
    parser.add_argument("--processes", type=int, default=1, metavar="N", help=f"{unit}s at a time (1)")
    parser.add_argument("--again", action="store_true", help=f"run those {unit}s again that did not pass")
    campaign.add_options(parser)
    return parser


#: Options that do not change a case.
_COMMON = ("n", "first", "o", "only", "processes", "again")


def _work(name: str, campaign: Campaign, cases: Mapping[str, Any], options: argparse.Namespace) -> int:
    """Run all cases, those first that are known, and conclude."""
    from tqdm import tqdm

    out: Path = options.o
    asked = {k: v for k, v in vars(options).items() if k not in _COMMON}
    head = {"source": source_digest(), "versions": versions(), "options": asked}

    def again(record: Record) -> bool:
        return options.again and not campaign.outcome(**record).passed

    store = Records(out / f"{name}.jsonl", head, again)
    try:
        store.begin()
    except OtherHead as error:
        raise ValueError(f"{store.path} {error}; give another folder") from error
    with sigterm_as_interrupt() as sigterm:
        try:
            campaign.prepare(out)
            with tqdm(total=len(cases), unit=campaign.unit) as bar:
                run = partial(_run, name, out)
                found = store.of_all(cases, run, options.processes, lambda record, known: bar.update())
        except KeyboardInterrupt:
            print("interrupted; start it again to resume", file=sys.stderr)
            return 143 if sigterm else 130
    outcomes = [campaign.outcome(**record) for record in found.values()]
    blocks = campaign.report(outcomes)
    campaign.table(outcomes).to_csv(out / f"{name}.csv", index=False)
    page = "\n\n".join(b if isinstance(b, str) else markdown(b) for b in blocks)
    write_text(page + "\n", out / f"{name}.md")
    campaign.write(outcomes, out)
    print("\n\n".join(b if isinstance(b, str) else b.to_string(index=False) for b in blocks))
    return 0 if campaign.passed(outcomes) else 1


def _run(name: str, out: Path, case: Any) -> Record:
    return plain(asdict(load(name).run(case, out)))


@cache
def source_digest(*packages: str) -> str:
    """Digest of the source of some packages of `tdcr_fe`, with those inside; without names, of all."""
    digest = hashlib.sha256()
    for package in packages or ("", "elements", "validation"):
        root = Path(str(files(f"tdcr_fe.{package}".rstrip("."))))
        for file in sorted(root.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def markdown(table: pd.DataFrame) -> str:
    """A table as Markdown."""
    rows = [list(table.columns), ["---"] * len(table.columns), *table.astype(object).to_numpy().tolist()]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)
