"""How the documentation is built: ``sphinx-build -W docs out/docs``."""

import re
import shutil
import sys
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

from tdcr_fe import __version__

sys.path.insert(0, str(Path(__file__).parent))
from draw_pictures import draw_missing, draw_moving_robot
from generate import write_generated

project = "tdcr-fe"
author = "the maintainers of tdcr-fe"
copyright = "2026, " + author
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "_generated", "examples", "gallery/**/*.ipynb", "gallery/**/*.py"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
suppress_warnings = ["misc.highlighting_failure"]

myst_enable_extensions = ["deflist", "dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
add_module_names = False
toc_object_entries = False
default_role = "code"

# Run by the build, unless it is told `-D plot_gallery=0`; `tests/test_docs.py` runs them as integration tests.
EXAMPLES_IN_ORDER = (
    "first_robot",
    "routings",
    "hysteresis",
    "friction_laws",
    "slack_and_displacement",
    "two_segments",
    "thick_disks",
    "gravity_and_payload",
    "soft_robot",
    "sensitivities",
    "tendon_jacobian",
    "critical_load",
    "inverse_statics",
    "design",
    "sweep",
    "robot_on_ground",
    "robot_on_carriage",
    "robot_on_arm",
    "robot_and_obstacles",
    "vibration",
    "modes",
    "cut_tendon",
    "tracking",
    "own_spreadsheet",
)
sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "subsection_order": [f"examples/{part}" for part in ("simulate", "analyse", "scene", "measured")],
    "within_subsection_order": "conf.in_order",
    "abort_on_example_error": True,
    "only_warn_on_example_error": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,  # that page would need a network
    "show_signature": False,
    "capture_repr": (),
    "min_reported_time": 1e9,
    "matplotlib_animations": False,
    "backreferences_dir": None,
}


def in_order(name: str) -> int:
    """Position of an example in its part of the gallery."""
    return EXAMPLES_IN_ORDER.index(Path(name).stem)


html_theme = "furo"
html_title = f"tdcr-fe {version}"
html_static_path = ["_static"]
html_extra_path = ["_generated/pages"]
(Path(__file__).parent / "_generated" / "pages").mkdir(
    parents=True, exist_ok=True
)  # filled by _write_generated
html_css_files = ["page.css"]
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}

# Formulas are set by MathJax 3 in the browser, with its own font. Script and font are files of the built
# pages, so that no network is needed; they are those of the Python package sphinx-mathjax-offline.
mathjax_path = "mathjax/tex-chtml.js"
# The menu would load files that are left out here.
mathjax3_config = {"options": {"enableMenu": False}, "chtml": {"scale": 0.95}}


def _copy_mathjax(app: Sphinx, exception: Exception | None) -> None:
    """Copy the script and its fonts, the part of the package that is used here, into the pages."""
    package = find_spec("sphinx-mathjax-offline")
    if package is None or package.origin is None:
        raise ExtensionError("the package sphinx-mathjax-offline is missing: pip install '.[docs]'")
    if exception is None and app.builder.format == "html":
        source, target = (
            Path(package.origin).parent / "static" / "mathjax",
            app.outdir / "_static" / "mathjax",
        )
        fonts = Path("output", "chtml", "fonts", "woff-v2")
        shutil.copytree(source / fonts, target / fonts, dirs_exist_ok=True)
        shutil.copy(source / "tex-chtml.js", target)


#: What a browser fetches with a page, from elsewhere.
_FROM_ELSEWHERE = re.compile(
    r"""<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//[^>]*>"""
)


def _need_no_network(app: Sphinx, exception: Exception | None) -> None:
    """Refuse pages that fetch a script, a font, a style or a picture from elsewhere."""
    if exception is None and app.builder.format == "html":
        found = {
            tag
            for page in Path(app.outdir).rglob("*.html")
            for tag in _FROM_ELSEWHERE.findall(page.read_text(encoding="utf-8"))
            if 'rel="canonical"' not in tag
        }
        if found:
            raise ExtensionError(f"these need a network: {sorted(found)}")


def _write_generated(app: Sphinx) -> None:
    """Write what the pages take from the program; draw missing pictures, but none with `-D plot_gallery=0`."""
    write_generated(Path(app.srcdir) / "_generated")
    if app.config.plot_gallery in ("0", "False", False):
        app.config.suppress_warnings.append("image.not_readable")
    elif app.builder.format == "html":
        draw_moving_robot(Path(app.srcdir) / "_generated")
        draw_missing(Path(app.srcdir) / "_generated" / "pictures")


# Napoleon takes what stands before the colon of a property's first line for its type.


def _no_type_in_a_property(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    if what in ("property", "attribute", "data") and lines:
        lines[0] = re.sub(r"(?<!:):(?= )", ";", lines[0], count=1)


# Napoleon does not know several attributes on one line ("length, radius : float"); each gets a line of its own.


def _one_attribute_a_line(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    several = re.compile(r"(\w+(?:, \w+)+) : (.*)")
    done: list[str] = []
    for k, line in enumerate(lines):
        found = several.fullmatch(line)
        if found is None:
            done.append(line)
            continue
        text = list(takewhile(lambda x: x.startswith(" "), lines[k + 1 :]))
        *first, last = found[1].split(", ")
        for attribute in first:
            done += [f"{attribute} : {found[2]}", *text]
        done.append(f"{last} : {found[2]}")
    lines[:] = done


def setup(app: Sphinx) -> None:
    """Prepare docstrings for Napoleon, write what is generated, copy MathJax, and find what needs a network."""
    app.connect("autodoc-process-docstring", _one_attribute_a_line, priority=100)
    app.connect("autodoc-process-docstring", _no_type_in_a_property, priority=100)
    app.connect("builder-inited", _write_generated)
    app.connect("build-finished", _copy_mathjax)
    app.connect("build-finished", _need_no_network)
