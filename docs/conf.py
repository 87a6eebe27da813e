"""How the documentation is built: ``sphinx-build -W docs out/docs``."""

import re
from itertools import takewhile

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

from tdcr_fe import __version__

project = "tdcr-fe"
author = "the maintainers of tdcr-fe"
copyright = "2026, " + author
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "_generated"]
source_suffix = {".md": "markdown"}
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

html_theme = "furo"
html_title = f"tdcr-fe {version}"
html_static_path = ["_static"]
html_css_files = ["page.css"]
html_show_sourcelink = False


# Formulas become MathML, which browsers draw themselves: the pages need no network and no script.


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    label = f' id="equation-{node["label"]}"' if node.get("label") else ""
    self.body.append(f'<div class="math"{label}>{number}{convert(node.astext(), display="block")}</div>\n')
    raise nodes.SkipNode


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
    """Take formulas over from Sphinx, and prepare docstrings for Napoleon."""
    app.connect("autodoc-process-docstring", _one_attribute_a_line, priority=100)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))


html_math_renderer = "mathml"
