"""Every example of the documentation asserts a number; printed output on pages agrees with the program."""

import argparse
import ast
import importlib
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import tdcr_fe
from tdcr_fe import cli

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "docs" / "first_robot.md"]
EXAMPLES = ROOT / "docs" / "examples"
SCRIPTS = sorted(EXAMPLES.rglob("*.py"))
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_every_page_that_is_linked_is_there():
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" in target:
                continue
            if target.startswith("gallery/"):  # made by the build of the pages from the examples
                source = target.removeprefix("gallery/").removesuffix(".rst")
                target = "examples/GALLERY_HEADER.rst" if source == "index" else f"examples/{source}.py"
            if target.startswith("_generated/pictures/"):  # drawn by the build of the pages
                drawn = (ROOT / "docs" / "draw_pictures.py").read_text(encoding="utf-8")
                assert f'"{Path(target).stem}"' in drawn, f"{page.name} points to {target}"
                continue
            assert (page.parent / target).exists(), f"{page.name} points to {target}"


@pytest.mark.parametrize("page", [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))], ids=lambda p: p.stem)
def test_every_path_that_a_page_names_exists(page):
    named = re.findall(
        r"`((?:elements|tdcr_fe|validation|tests|docs)/[\w./]*)`", page.read_text(encoding="utf-8")
    )
    assert not [n for n in named if not (ROOT / n).exists()]
    assert page.stem != "where_to_change" or len(set(named)) > 20


def test_every_list_on_the_page_where_to_change_is_in_its_file():
    """As in "a class in FILE, its name in LIST there", or "LIST of FILE"."""
    page = (ROOT / "docs" / "where_to_change.md").read_text(encoding="utf-8")
    there = re.findall(r"`([\w/]+\.py)` \| its (?:name|object) in `([A-Z_]+)` there", page)
    other = [(file, name) for name, file in re.findall(r"`([A-Z_]+)` of `([\w/]+\.py)`", page)]
    assert len(there + other) >= 3
    for file, name in there + other:
        assert re.search(rf"^{name}\b", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), (file, name)


def test_the_api_page_documents_every_public_name():
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    whole = set(re.findall(r"automodule:: ([\w.]+)\n(?!   :members:)", page))
    single = set(re.findall(r"auto(?:function|class|exception):: ([\w.]+)", page))
    single |= {
        f"{module}.{name.strip()}"
        for module, names in re.findall(r"automodule:: ([\w.]+)\n   :members: (.*)", page)
        for name in names.split(",")
    }
    missing = []
    for name in set(tdcr_fe.__all__) - {"__version__"}:
        module = "tdcr_fe.identify" if name == "identify" else getattr(tdcr_fe, name).__module__
        if module not in whole and f"{module}.{name}" not in single:
            missing.append(f"{module}.{name}")
    assert not missing


def test_readme_has_a_row_for_every_command():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `tdcr-fe (\w+)", readme, re.MULTILINE)
    places = [place.partition(":") for place in cli.COMMANDS]
    commands = argparse.ArgumentParser().add_subparsers()
    for module, _, function in places:
        getattr(importlib.import_module(module), function)(commands)
    assert sorted(rows) == sorted(commands.choices)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_example_asserts_a_number_and_has_its_place_in_the_gallery(script):
    tree = ast.parse(script.read_text(encoding="utf-8"))
    assert any(isinstance(node, ast.Assert) for node in ast.walk(tree))
    title, underline = ast.get_docstring(tree).splitlines()[:2]
    assert set(underline) == {"="} and len(underline) == len(title)
    order = re.search(
        r"EXAMPLES_IN_ORDER = \((.*?)\)", (ROOT / "docs" / "conf.py").read_text(encoding="utf-8"), re.DOTALL
    )
    assert re.findall(r'"(\w+)"', order[1]).count(script.stem) == 1
    assert (script.parent / "GALLERY_HEADER.rst").exists()


def test_the_gallery_has_twenty_examples():
    assert len(SCRIPTS) >= 20


@pytest.mark.campaign  # The build of the pages runs them: CI does so.
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_example_runs(script, tmp_path):
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_picture_of_the_readme_is_that_of_the_demo(monkeypatch, tmp_path):
    """Small grey copies differ by less than half of the drawn lines; that of 0.1 showed an older run."""
    from PIL import Image

    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    drawing = importlib.import_module("draw_pictures")
    drawing.draw_demo(tmp_path)

    def thumbnail(path: Path) -> np.ndarray:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("L").resize((80, 50)), dtype=float) / 255.0

    stored, drawn = thumbnail(drawing.OF_THE_README), thumbnail(tmp_path / drawing.OF_THE_README.name)
    assert np.mean(np.abs(stored - drawn)) < 0.5 * np.mean(1.0 - drawn)


def test_pages_show_pictures_of_their_own_build():
    """Kept in the repository are only the picture of the README, and those that ``tdcr-fe paper --docs`` writes."""
    kept = {p.name for p in (ROOT / "docs" / "pictures").iterdir()}
    assert {name for name in kept if not name.startswith("paper_")} == {"shapes.png"}
    for page in (ROOT / "docs").glob("*.md"):
        if page.stem != "paper":
            assert "](pictures/" not in page.read_text(encoding="utf-8"), page.name


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_commands_and_code_of_a_page_give_what_it_shows(page, monkeypatch, tmp_path, capsys):
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
    """Rows of a shown table agree with the printed ones, but for the last digit and the number of iterations."""
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


def test_the_citation_names_the_version_of_the_package():
    """Version 0.1.0 was still named when the package was 0.2.0.dev0."""
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (
        re.search(r"^version: (.+)$", citation, re.MULTILINE)[1] == project["version"] == tdcr_fe.__version__
    )


def toctrees() -> list[tuple[str, list[str]]]:
    """Caption and pages of every part of the navigation."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    parts = re.findall(r"^```\{toctree\}\n(.*?)^```$", index, re.MULTILINE | re.DOTALL)
    found = []
    for part in parts:
        options, _, pages = part.partition("\n\n")
        caption = re.search(r"^:caption: (.+)$", options, re.MULTILINE)
        found.append((caption[1] if caption else "", pages.split()))
    return found


def test_the_navigation_has_captions_and_every_page_once():
    """Version 0.1 had one flat list without captions, whose end was alphabetical."""
    captions, pages = zip(*toctrees(), strict=True)
    assert captions == (
        "Begin",
        "Simulate",
        "In a scene",
        "My measured robot",
        "Understand",
        "Reference",
        "Develop",
    )
    listed = [page for part in pages for page in part if "/" not in page]
    assert len(listed) == len(set(listed))
    assert set(listed) == {p.stem for p in (ROOT / "docs").glob("*.md")} - {"index"}
