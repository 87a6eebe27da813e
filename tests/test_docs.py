"""Every example of the documentation runs, and asserts a number; what pages show of output is what comes out."""

import argparse
import ast
import importlib
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

from tdcr_fe import cli

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "docs" / "first_robot.md"]
EXAMPLES = ROOT / "docs" / "examples"
SCRIPTS = sorted(p for p in EXAMPLES.glob("*.py") if p.name != "picture.py")
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_every_page_that_is_linked_is_there():
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name} points to {target}"


def test_readme_has_a_row_for_every_command():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `tdcr-fe (\w+)", readme, re.MULTILINE)
    places = [place.partition(":") for place in cli.COMMANDS]
    commands = argparse.ArgumentParser().add_subparsers()
    for module, _, function in places:
        getattr(importlib.import_module(module), function)(commands)
    assert sorted(rows) == sorted(commands.choices)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_example_runs_and_asserts(script, monkeypatch, tmp_path):
    assert any(
        isinstance(node, ast.Assert) for node in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(script)])
    runpy.run_path(str(script), run_name="__main__")


def test_example_draws_its_picture_without_a_display(monkeypatch, tmp_path):
    picture = tmp_path / "picture.png"
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.setattr(sys, "argv", ["robot_on_ground.py", str(picture)])
    runpy.run_path(str(EXAMPLES / "robot_on_ground.py"), run_name="__main__")
    import matplotlib.pyplot as plt

    drawn = plt.imread(picture)
    assert drawn.shape[:2] == (700, 900)
    # Backbone and disks, and the three tendons in their colours.
    assert (drawn[..., :3].min(axis=2) < 0.7).mean() > 0.01
    red, green, blue = drawn[..., 0], drawn[..., 1], drawn[..., 2]
    for seen in (red > blue + 0.4, blue > red + 0.4, (green > red + 0.3) & (green > blue + 0.1)):
        assert seen.sum() > 100


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_page_says_what_happens(page, monkeypatch, tmp_path, capsys):
    """From top to bottom: input files are written, commands run, Python blocks run in one namespace."""
    monkeypatch.chdir(tmp_path)
    namespace = {}
    asserted = 0
    for language, text in FENCE.findall(page.read_text(encoding="utf-8")):
        named = re.match(r"# ([\w.]+\.toml)\n", text)
        if language == "toml" and named:
            (tmp_path / named[1]).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, str(page), "exec"), namespace)
            asserted += text.count("assert ")
        elif language == "console":
            commands = re.findall(r"^\$ (?:\.venv/bin/)?tdcr-fe (.*)$", text, re.MULTILINE)
            for command in commands:
                assert cli.main(shlex.split(command)) == 0, command
            if commands:
                printed = capsys.readouterr().out
            elif text.startswith("step "):
                asserted += compare_tables(text, printed)
    assert asserted > 0


def compare_tables(shown, printed):
    """Every row of a table of steps is printed so, but for the last digit and the number of iterations."""
    rows = [line.rsplit(None, 1)[0] for line in shown.splitlines() if re.match(r"\s*\d+  ", line)]
    there = {line.split()[0]: line for line in printed.splitlines() if re.match(r"\s*\d+  ", line)}
    for row in rows:
        for word, other in zip(row.split(), there[row.split()[0]].split(), strict=False):
            if re.fullmatch(r"-?\d+\.\d+", word):
                assert abs(float(word) - float(other)) <= 1.5 * 10.0 ** -len(word.split(".")[1]), (row, other)
            else:
                assert word == other, (row, other)
    assert rows
    return len(rows)
