"""How large the project is: lines that carry code, room by room, beside the budget, and what a change adds or removes.

Usage: ``python .ci/size.py [--base REVISION]`` in a git checkout. Docstrings, comments and blank lines do not count.
Exit status 1 where a room, the product or the documentation is over its budget.

A room that needs more takes something out first. Nothing is packed to fit: the formatter, names, public docstrings and
checks stay as they are.
"""

from __future__ import annotations

import argparse
import ast
import functools
import io
import re
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

#: Lines of code that a room may have: what it has where that is still more than it should be.
BUDGET = {
    "elements": 2361,
    "tdcr_fe": 235,
    "tdcr_fe/commands": 743,
    "tdcr_fe/effects": 1132,
    "tdcr_fe/estimate": 1440,
    "tdcr_fe/identify": 6080,
    "tdcr_fe/io": 1657,
    "tdcr_fe/live": 333,
    "tdcr_fe/model": 2400,
    "tdcr_fe/report": 1059,
    "tdcr_fe/scene": 1308,
    "tdcr_fe/solve": 6059,
    "tdcr_fe/sweeps": 1360,
    "validation": 6435,
    "tests": 12544,
}
#: Rooms that are no part of the product.
BESIDE = ("tests", "validation")
#: Words in all pages under `docs`.
WORDS = 38000
#: More parameters than these are counted, and files below and above these numbers of lines.
PARAMETERS, SMALL, LARGE = 5, 80, 500

NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


@dataclass
class Size:
    """What is counted in a tree, by room."""

    code: Counter[str] = field(default_factory=Counter)
    files: Counter[str] = field(default_factory=Counter)
    wide: Counter[str] = field(default_factory=Counter)  # functions of more than five parameters
    numbers: Counter[str] = field(default_factory=Counter)  # constants in capitals
    small: Counter[str] = field(default_factory=Counter)
    large: Counter[str] = field(default_factory=Counter)
    words: int = 0

    @property
    def product(self) -> int:
        """Lines of code of all rooms that are installed for users, but validation."""
        return sum(lines for room, lines in self.code.items() if room not in BESIDE)


def measure(top: Path, names: list[str]) -> Size:
    """Count the files ``names`` below ``top``."""
    size = Size()
    for name in names:
        path = top / name
        if not path.is_file():
            continue
        if name.startswith("docs/") and name.endswith(".md"):
            size.words += len(path.read_text(encoding="utf-8").split())
        elif name.endswith(".py") and not name.startswith(("docs/", ".ci/")):
            _add(size, name, path.read_text(encoding="utf-8"))
    return size


def _add(size: Size, name: str, text: str) -> None:
    parts = name.split("/")
    room = "/".join(parts[:2]) if parts[0] == "tdcr_fe" and len(parts) > 2 else parts[0]
    tree = ast.parse(text)
    size.code[room] += len(_lines_with_tokens(text) - _lines_of_docstrings(tree))
    size.files[room] += 1
    size.small[room] += text.count("\n") < SMALL and parts[-1] != "__init__.py"
    size.large[room] += text.count("\n") > LARGE
    if room != "tests":
        size.wide[room] += sum(_is_wide(node) for node in ast.walk(tree))
        size.numbers[room] += sum(_named_numbers(node) for node in tree.body)


@functools.cache  # most files are the same before and after a change
def _lines_with_tokens(text: str) -> set[int]:
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    return lines


def _lines_of_docstrings(tree: ast.Module) -> set[int]:
    lines: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            first = node.body[0] if node.body else None
            if ast.get_docstring(node, clean=False) is not None and isinstance(first, ast.Expr):
                lines.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return lines


def _is_wide(node: ast.AST) -> bool:
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([a for a in given if a.arg not in ("self", "cls")]) > PARAMETERS


def _named_numbers(node: ast.stmt) -> int:
    if not isinstance(node, ast.Assign) or not any(_is_number(n) for n in ast.walk(node.value)):
        return 0
    targets = [t for target in node.targets for t in getattr(target, "elts", [target])]
    return sum(isinstance(t, ast.Name) and bool(re.fullmatch(r"_?[A-Z][A-Z0-9_]+", t.id)) for t in targets)


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], capture_output=True, check=True).stdout


def at_revision(revision: str) -> Size | None:
    """Count the files of a commit; None where the checkout does not hold it."""
    known = subprocess.run(
        ["git", "rev-parse", "-q", "--verify", f"{revision}^{{commit}}"], capture_output=True
    )
    if known.returncode:
        return None
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(_git("archive", revision))) as archive:
            archive.extractall(folder, filter="data")
        top = Path(folder)
        return measure(top, [str(p.relative_to(top)) for p in top.rglob("*") if p.is_file()])


def report(now: Size, before: Size) -> list[str]:
    """Print the table; the names of what is over its budget."""
    over = [room for room, lines in now.code.items() if lines > BUDGET.get(room, 0)]
    print(
        f"{'room':20s} {'code':>6s} {'change':>7s} {'budget':>7s} {'files':>6s} {'>5 params':>10s} {'numbers':>8s}"
        f" {'<80':>4s} {'>500':>5s}"
    )
    for room in sorted(now.code):
        change = now.code[room] - before.code[room]
        print(
            f"{room:20s} {now.code[room]:6d} {change:+7d} {BUDGET.get(room, 0):7d} {now.files[room]:6d}"
            f" {now.wide[room]:10d} {now.numbers[room]:8d} {now.small[room]:4d} {now.large[room]:5d}"
            f"{'  over' if room in over else ''}"
        )
    budget = sum(lines for room, lines in BUDGET.items() if room not in BESIDE)
    print(f"{'product':20s} {now.product:6d} {now.product - before.product:+7d} {budget:7d}")
    print(f"{'words of docs/*.md':20s} {now.words:6d} {now.words - before.words:+7d} {WORDS:7d}")
    return [*over, *(["docs"] if now.words > WORDS else [])]


def main() -> int:
    """Measure the tracked files and those of the base."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--base", default="HEAD~1", help="the change is counted from here (HEAD~1)")
    base = parser.parse_args().base
    top = Path(_git("rev-parse", "--show-toplevel").decode().strip())
    names = _git("-C", str(top), "ls-files", "-z").decode().split("\0")
    now, before = measure(top, names), at_revision(base)
    if before is None:
        print(f"no commit {base} in this checkout: changes are not counted")
    over = report(now, before or now)
    if over:
        print("over the budget:", ", ".join(over))
    return bool(over)


if __name__ == "__main__":
    sys.exit(main())
