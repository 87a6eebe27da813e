"""Collects from the source every message that a user can get: errors, problems of input files, warnings of results."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

#: Exceptions that are a matter of the program itself: abstract methods, interruptions, ends of searches within.
INTERNAL = {
    "NotImplementedError",
    "KeyboardInterrupt",
    "Terminated",
    "_Interrupted",
    "StructureChanged",
    "ExecutorBroken",
    "np.linalg.LinAlgError",
    "AttributeError",
}
#: Functions and classes that are given a message, besides exceptions.
TAKE_A_MESSAGE = {
    "Problem",
    "Contradiction",
    "Mistake",
    "FieldError",
    "KeyProblem",
    "warn",
    "_error",
    "_refuse",
    "refuse",
    "report",
    "reporter",
    "_Fault",
    "problem",
    "complain",
    "wrong_type",
    "Unmet",
}
#: Functions whose returned text is a message, or a part of one.
RETURN_A_MESSAGE = {
    "advice",
    "_allowed",
    "failure",
    "hole_count_text",
    "problem",
    "reason",
    "sentence",
    "wrong_type",
    "_coarser_mesh_kept",
    "_outcome_on_coarser_mesh",
    "_taken",
}
#: Files in which every text is a message, or every text of one class.
ALL_MESSAGES = {"tdcr_fe/identify/data_faults.py": "", "tdcr_fe/solve/newton/convergence.py": "NewtonStatus"}
#: Here `report` takes what is going on, not what is wrong.
PROGRESS = "tdcr_fe/identify/"
#: Words that make a message.
LEAST_WORDS = 3
#: A value in a message.
VALUE = "…"


class Message(NamedTuple):
    """A message in the source."""

    place: str
    text: str


def text_of(node: ast.expr, names: dict[str, list[ast.expr]]) -> list[str]:
    """What an expression may say, with `VALUE` for what is computed; empty where it is no text."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        return ["".join(v.value if isinstance(v, ast.Constant) else VALUE for v in node.values)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = text_of(node.left, names) or [VALUE], text_of(node.right, names) or [VALUE]
        joined = [a + b for a in left for b in right]
        return [] if joined == [VALUE + VALUE] else joined
    if isinstance(node, ast.IfExp):
        return text_of(node.body, names) + text_of(node.orelse, names)
    if isinstance(node, ast.Name):
        return [text for value in names.get(node.id, []) for text in text_of(value, {})]
    return []


def assigned(function: ast.AST) -> dict[str, list[ast.expr]]:
    """Expressions that a function assigns to names."""
    found: dict[str, list[ast.expr]] = {}
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            found.setdefault(node.targets[0].id, []).append(node.value)
    return found


def spoken(function: ast.AST, progress: bool) -> Iterator[tuple[int, ast.expr]]:
    """Expressions in a function that become messages, with their lines; ``progress``: see `PROGRESS`."""
    warns = isinstance(function, ast.FunctionDef) and "warning" in function.name
    returns = isinstance(function, ast.FunctionDef) and function.name in RETURN_A_MESSAGE and not progress
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            if ast.unparse(node.exc.func) not in INTERNAL:
                yield from ((node.lineno, a) for a in node.exc.args)
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func).rpartition(".")[2]
            if name in TAKE_A_MESSAGE and not (progress and name == "report"):
                yield from ((node.lineno, a) for a in node.args[-2:])
                yield from ((node.lineno, k.value) for k in node.keywords)
            elif warns and name in ("append", "extend"):
                yield from ((node.lineno, a) for a in node.args)
        elif returns and isinstance(node, ast.Return) and node.value is not None:
            value = node.value
            parts = (
                value.elts
                if isinstance(value, ast.Tuple)
                else value.args
                if isinstance(value, ast.Call)
                else [value]
            )
            yield from ((node.lineno, e) for e in parts)
        elif warns and isinstance(node, ast.AugAssign | ast.Return) and node.value is not None:
            lists = [e for e in ast.walk(node.value) if isinstance(e, ast.List)]
            yield from ((node.lineno, e) for each in lists for e in each.elts)


def every_text(tree: ast.AST) -> Iterator[tuple[int, ast.expr]]:
    """Every text that is not a docstring, an annotation or a part of another text."""
    within = {
        id(part)
        for node in ast.walk(tree)
        for part in (
            node.values
            if isinstance(node, ast.JoinedStr)
            else [node.value]
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            else []
        )
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr | ast.Constant) and id(node) not in within:
            yield node.lineno, node


def of_file(path: Path, name: str) -> Iterator[tuple[int, str]]:
    """Messages of a file, with their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if name in ALL_MESSAGES:
        part = [n for n in ast.walk(tree) if isinstance(n, ast.ClassDef) and n.name == ALL_MESSAGES[name]]
        for line, node in every_text(part[0] if part else tree):
            yield from ((line, text) for text in text_of(node, {}))
    for function in (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)):
        names = assigned(function)
        for line, node in spoken(function, name.startswith(PROGRESS)):
            yield from ((line, text) for text in text_of(node, names))


def messages(root: Path, words: int = LEAST_WORDS) -> list[Message]:
    """Every message of the product with so many words or more, each text once."""
    found: dict[str, Message] = {}
    for folder in ("tdcr_fe", "elements"):
        for path in sorted((root / folder).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            for line, text in of_file(path, name):
                if len([w for w in text.replace(VALUE, " ").split() if w.isalpha()]) >= words:
                    found.setdefault(text, Message(f"{name}:{line}", text))
    return list(found.values())
