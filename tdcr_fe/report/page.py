"""A report as one HTML page: a verdict, a few figures, and sections that give their template and their context.

Which sections, and in which order: ``report.py`` in `identify`, `sweeps` and `estimate`, and
``validation/crosscheck/page.py``.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from markupsafe import Markup
from matplotlib.figure import Figure

from tdcr_fe.report.environment import environment
from tdcr_fe.report.style import panels

#: Level of a verdict or a mark in a table: as required, in part, not as required, or undecided.
Level = Literal["good", "part", "bad", "open"]


@dataclass(frozen=True)
class Picture:
    """A figure inside a page.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        Its axes become panels that a narrow page shows below each other.
    text : str
        What it shows, for readers who do not see it.
    caption : str
        Below the figure: what the marks mean.
    """

    figure: Figure
    text: str
    caption: str = ""

    @property
    def panels(self) -> list[tuple[str, float]]:
        """Each panel as a data address, so that the page needs no other file, and its width in pixels."""
        return [
            (f"data:image/svg+xml;base64,{base64.b64encode(text.encode()).decode()}", width)
            for text, width in panels(self.figure)
        ]


@dataclass(frozen=True)
class Card:
    """One number of the first screen.

    Attributes
    ----------
    value : str
        With its unit.
    text : str
        What it is.
    """

    value: str
    text: str


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes
    ----------
    anchor : str
        Its address within the page.
    title : str
    template : str
        File among the templates of the report's package.
    context : mapping
        What the template refers to.
    folded : bool
        Whether the reader opens it.
    """

    anchor: str
    title: str
    template: str
    context: Mapping[str, Any] = field(default_factory=dict)
    folded: bool = True


@dataclass(frozen=True)
class Page:
    """A whole report.

    Attributes
    ----------
    title : str
        Title of the window and above the verdict.
    verdict : str
        One sentence.
    level : Level
    sentences : tuple of str
        Further sentences of the first screen, one or two lines each.
    cards : tuple of Card
    pictures : tuple of Picture
        Pictures of the first screen.
    summary : Section or None
        Rest of the first screen, without a title.
    sections : tuple of Section
    notes : tuple of str
        At the end: versions, time, command.
    has_panel : bool
        Whether a section has the 3D panel (see `tdcr_fe.report.viewer.panel`).
    """

    title: str
    verdict: str
    level: Level
    sentences: tuple[str, ...] = ()
    cards: tuple[Card, ...] = ()
    pictures: tuple[Picture, ...] = ()
    summary: Section | None = None
    sections: tuple[Section, ...] = ()
    notes: tuple[str, ...] = ()
    has_panel: bool = False


def render(page: Page, package: str) -> str:
    """The page as one HTML file that needs nothing else.

    Parameters
    ----------
    page
        What to show.
    package
        Full name of the package whose folder ``templates`` holds the templates of the sections.
    """
    made = environment(package)

    def text(section: Section) -> Markup:
        return Markup(made.get_template(section.template).render(section.context))

    return made.get_template("report.html.j2").render(
        page=page,
        summary=text(page.summary) if page.summary else "",
        sections=[(s, text(s)) for s in page.sections],
        has_panel=page.has_panel,
    )
