"""Pages: links, names, examples and printed output agree with the program; every example asserts a number."""

import ast
import importlib
import re
import runpy
import shlex
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import tdcr_fe
from tdcr_fe import cli
from tdcr_fe.model.limits import limits

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
SCRIPTS = sorted((DOCS / "examples").rglob("*.py"))
#: Examples that take minutes, and the others, which run with the integration tests.
LONG = [pytest.param(p, marks=pytest.mark.campaign, id=p.stem) for p in SCRIPTS if p.stem == "tracking"]
QUICK = [pytest.param(p, marks=pytest.mark.integration, id=p.stem) for p in SCRIPTS if p.stem != "tracking"]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def anchors(page: Path) -> set[str]:
    """Headings of a page as in links."""
    text = re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)
    headings = re.findall(r"^#{1,3} (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda p: p.stem)
def test_links_lead_to_pages_and_headings_that_are_there(page):
    for target, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", text_of(page)):
        if "://" in target or target.startswith("_generated/"):
            continue
        if target.startswith("gallery/"):  # made by the build of the pages from the examples
            source = target.removeprefix("gallery/").removesuffix(".rst")
            target = "examples/GALLERY_HEADER.rst" if source == "index" else f"examples/{source}.py"
        linked = page.parent / target if target else page
        assert linked.exists(), target
        assert not anchor or anchor in anchors(linked), (target, anchor)


def test_messages_and_docstrings_name_pages_and_sections_that_are_there():
    for folder in ("elements", "tdcr_fe", "validation", "tests"):
        for source in (ROOT / folder).rglob("*.py"):
            text = re.sub(r"\s+", " ", text_of(source)).replace('\\"', '"')
            for name, section in re.findall(r'docs/(\w+\.md)(?:, section "([^"]+)")?', text):
                assert (DOCS / name).exists(), (source.name, name)
                assert not section or f"# {section}\n" in text_of(DOCS / name), (source.name, section)
            assert not re.search(r'pages? ["\'][A-Z]\w+["\']', text) or folder == "tests", source.name


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_every_path_that_a_page_names_exists(page):
    named = re.findall(r"`((?:elements|tdcr_fe|validation|tests|docs)/[\w./]*)`", text_of(page))
    assert not [n for n in named if not (ROOT / n).exists()]


def test_every_list_on_the_page_architecture_is_in_its_file():
    lists = re.findall(r"`([A-Z_]+)` of `([\w/]+\.py)`", text_of(DOCS / "architecture.md"))
    assert len(lists) >= 6
    for name, file in lists:
        assert re.search(rf"^{name}\b", text_of(ROOT / file), re.MULTILINE), (file, name)


def test_the_api_page_has_every_public_name(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    shown = re.findall(r"auto\w+:: [\w.]+\.(\w+)", importlib.import_module("generate").api())
    assert set(tdcr_fe.__all__) - {"__version__"} <= set(shown)
    assert len(shown) == len(set(shown))


def test_readme_has_a_row_for_every_command():
    rows = re.findall(r"^\| `tdcr-fe (\w+)", text_of(ROOT / "README.md"), re.MULTILINE)
    assert sorted(rows) == sorted(cli.COMMANDS)


def test_the_page_validation_has_a_row_for_every_campaign():
    rows = re.findall(r"^\| `(\w+)(?: [^`]*)?` \| ", text_of(DOCS / "validation.md"), re.MULTILINE)
    assert {p.stem for p in (ROOT / "validation" / "campaigns").glob("*.py")} - {"__init__"} <= set(rows)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_example_asserts_a_number_and_has_its_place_in_the_gallery(script):
    tree = ast.parse(text_of(script))
    assert any(isinstance(node, ast.Assert) for node in ast.walk(tree))
    title, underline = ast.get_docstring(tree).splitlines()[:2]
    assert set(underline) == {"="} and len(underline) == len(title)
    order = re.search(r"EXAMPLES_IN_ORDER = \((.*?)\)", text_of(DOCS / "conf.py"), re.DOTALL)
    assert re.findall(r'"(\w+)"', order[1]).count(script.stem) == 1


@pytest.mark.parametrize("script", [*QUICK, *LONG])
def test_example_runs(script, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    plt.close("all")


@pytest.mark.parametrize("name", ["README.md", "docs/first_robot.md", "docs/architecture.md"])
def test_commands_and_code_of_a_page_give_what_it_shows(name, monkeypatch, tmp_path, capsys):
    """From top to bottom: input files are written, commands run, Python blocks run in one namespace."""
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": __name__}
    asserted = 0
    for language, text in FENCE.findall(text_of(ROOT / name)):
        named = re.match(r"# ([\w.]+\.toml)\n", text)
        if language == "toml" and named:
            (tmp_path / named[1]).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, name, "exec", dont_inherit=True), namespace)
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
    """Rows of a shown table agree with the beginnings of the printed ones, but for the last digit."""
    rows = [line for line in shown.splitlines() if re.match(r"\s*\d+  ", line)]
    there = {line.split()[0]: line for line in printed.splitlines() if re.match(r"\s*\d+  ", line)}
    for row in rows:
        for word, other in zip(row.split(), there[row.split()[0]].split(), strict=False):
            if re.fullmatch(r"-?\d+\.\d+", word):
                assert abs(float(word) - float(other)) <= 1.5 * 10.0 ** -len(word.split(".")[1]), (row, other)
            else:
                assert word == other, (row, other)
    assert rows
    return len(rows)


def texts_of_the_program() -> str:
    """Every text in the source, values as ``…``, one a line."""
    found = [row.says for row in limits().values()]
    for folder in ("elements", "tdcr_fe"):
        for source in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(text_of(source))):
                if isinstance(node, ast.JoinedStr):
                    parts = [v.value if isinstance(v, ast.Constant) else "…" for v in node.values]
                    found.append("".join(parts))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
    return "\n".join(text.replace("\n", " ") for text in found)


def test_messages_on_the_page_troubleshooting_are_those_of_the_program():
    lines = text_of(DOCS / "troubleshooting.md").splitlines()
    terms = [a for a, b in pairwise(lines) if b.startswith(": ") and not a.startswith("*")]
    quoted = [word for term in terms for word in re.findall(r"`([^`]+)`", term)]
    texts = texts_of_the_program()
    patterns = {q: ".*?".join(map(re.escape, q.split("…"))) for q in quoted}
    stale = [q for q, pattern in patterns.items() if not re.search(pattern, texts)]
    assert len(quoted) >= 30 and stale == ["has no attribute 'CreateTDCR'"]  # which Python says


def test_citation_and_changelog_name_the_version_and_its_date():
    cited = dict(re.findall(r"^([\w-]+): (.+)$", text_of(ROOT / "CITATION.cff"), re.MULTILINE))
    newest = re.search(r"^## \[(.+)\] - (.+)$", text_of(ROOT / "CHANGELOG.md"), re.MULTILINE)
    assert (cited["version"], cited["date-released"]) == newest.groups()
    assert cited["version"] == tdcr_fe.__version__


def test_the_navigation_has_every_page_once():
    trees = re.findall(r"(?ms)^```\{toctree\}\n.*?\n\n(.*?)^```$", text_of(DOCS / "index.md"))
    listed = [page for tree in trees for page in tree.split() if "/" not in page]
    assert sorted(listed) == sorted({p.stem for p in DOCS.glob("*.md")} - {"index"})


def test_the_changes_of_a_version_fit_one_screen():
    versions = text_of(ROOT / "CHANGELOG.md").split("\n## ")[1:]
    assert all(version.count("\n") <= 50 for version in versions)
