"""The product broken by hand in one place at a time: which test notices.

Each mutation is a line of the product and what it becomes (`mutations.toml`); the line is found by its text. The tests
run in a temporary copy of the clone: first the files that are nearest to the mutation, then all default tests, then the
integration tests.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.validation.runner import Campaign

#: The clone: mutations need its tests.
CLONE = Path(__file__).parents[2]
#: Folders of the product in which lines are looked for.
PRODUCT = ("elements", "tdcr_fe")
#: Tiers of the tests, as pytest's marker expressions, in the order in which they run.
TIERS = {"default": "not integration and not campaign", "integration": "integration"}
#: Mutations that only the integration tests may catch.
MOST_LATE = 2


class Mutation(NamedTuple):
    """A line of the product, and what it becomes."""

    line: str  # occurs once in the product; several lines where one is not enough
    becomes: str
    near: list[str]  # test files that should notice, below tests/


#: The table in `mutations.toml`.
TABLE = (Path(__file__).parents[1] / "mutations.toml").read_text(encoding="utf-8")
MUTATIONS: Mapping[str, Mutation] = {name: Mutation(**x) for name, x in tomllib.loads(TABLE).items()}


@dataclass(frozen=True)
class Outcome:
    """Which test notices a mutation."""

    mutation: str
    file: str  # of the product
    tier: str  # whose tests notice, empty where none does
    caught_by: str  # the first test that fails
    problem: str  # why it could not be tried; empty where it was

    @property
    def passed(self) -> bool:
        """Whether a test notices."""
        return bool(self.tier)


def place(line: str, root: Path = CLONE) -> Path:
    """The file with a line of the product, relative to the root.

    Raises
    ------
    ValueError
        The line does not occur exactly once: the table needs its present text.
    """
    files = [f for folder in PRODUCT for f in sorted((root / folder).rglob("*.py"))]
    found = [f for f in files for _ in range(f.read_text(encoding="utf-8").count(line))]
    if len(found) != 1:
        raise ValueError(f"occurs {len(found)} times: {line!r}")
    return found[0].relative_to(root)


@contextmanager
def mutated(mutation: Mutation) -> Iterator[tuple[Path, Path]]:
    """A copy of the clone with a mutation, and the file that has it."""
    file = place(mutation.line)
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "clone"
        shutil.copytree(CLONE, copy, ignore=shutil.ignore_patterns(".*", "__pycache__", "out"))
        text = (copy / file).read_text(encoding="utf-8")
        (copy / file).write_text(text.replace(mutation.line, mutation.becomes), encoding="utf-8")
        yield copy, file


def run_tests(copy: Path, tests: Sequence[str], tier: str, workers: int) -> str:
    """The first test that fails in a copy; empty where all pass.

    Raises
    ------
    RuntimeError
        The tests could not run: the mutation breaks an import, or a file is not there.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "--no-header", "-p", "no:cacheprovider"]
    command += ["-n", str(workers), "-m", TIERS[tier], *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    failed = re.search(r"^(?:FAILED|ERROR) (\S.*?)(?: - |$)", done.stdout, re.MULTILINE)
    if done.returncode == 1 and failed:
        return failed.group(1)
    if done.returncode in (0, 5):  # 5: no tests of this tier
        return ""
    raise RuntimeError((done.stdout + done.stderr)[-1000:])


def try_mutation(name: str, near_only: bool, workers: int) -> Outcome:
    """Mutate a copy, and run tests until one notices."""
    try:
        with mutated(MUTATIONS[name]) as (copy, file):
            near = [f"tests/{path}" for path in MUTATIONS[name].near if (copy / "tests" / path).exists()]
            runs = [(near, "default", 0)] if near else []
            if not near_only:
                runs += [([], tier, workers) for tier in TIERS]
            for tests, tier, number in runs:
                test = run_tests(copy, tests, tier, number)
                if test and run_tests(CLONE, [test], tier, 0):
                    raise RuntimeError(f"{test} fails without the mutation, too")
                if test:
                    return Outcome(name, str(file), tier, test, "")
            return Outcome(name, str(file), "", "", "")
    except (ValueError, RuntimeError) as error:
        return Outcome(name, "", "", "", str(error))


class Mutations(Campaign):
    """See the text of this module."""

    unit = "mutation"
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """How far to go."""
        parser.add_argument("--near", action="store_true", help="only the tests nearest to each mutation")
        parser.add_argument("--workers", type=int, default=2, help="of pytest, for all tests (2)")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """All mutations."""
        return {name: (name, options.near, options.workers) for name in MUTATIONS}

    def run(self, case: tuple[str, bool, int], out: Path) -> Outcome:
        """Break the product and run the tests."""
        return try_mutation(*case)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Which test notices, and how many do."""
        tried, early = count(len(outcomes), self.unit), sum(o.tier == "default" for o in outcomes)
        caught = sum(o.passed for o in outcomes)
        return [self.table(outcomes), f"{tried}: {early} caught by the default tests, {caught} by all tests"]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """All are caught, nearly all of them by the default tests."""
        return all(o.passed for o in outcomes) and sum(o.tier != "default" for o in outcomes) <= MOST_LATE


CAMPAIGN = Mutations()
