"""The command ``tdcr-fe view``: a folder of results as an interactive 3D page, and as video or geometry files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tdcr_fe.commands.status import SUCCESS


def add_view_parser(commands: Any) -> None:
    """Add ``tdcr-fe view``."""
    parser = commands.add_parser(
        "view",
        help="draw results in 3D, as one HTML file",
        description="Write one HTML file with the robot in 3D, a slider over the load steps, and plots that follow it. "
        "It opens in a browser without a server and without a network.",
    )
    parser.add_argument("result", metavar="RESULT", help="folder that tdcr-fe run, follow or identify wrote")
    parser.add_argument("-o", "--out", metavar="FILE.html", help="the page [RESULT/view.html]")
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")
    parser.set_defaults(handler=view)


def view(args: argparse.Namespace) -> int:
    """Read the results and write the page."""
    from tdcr_fe.io.atomic import write_text
    from tdcr_fe.io.result_folder import read_motion
    from tdcr_fe.report.viewer import summary, view_page

    out = _page(args.result, args.out)
    motion = read_motion(args.result)
    write_text(view_page(motion), out)
    if not args.quiet:
        print(f"{motion.name}: {summary(motion)}. Written: {out} ({out.stat().st_size / 1e6:.2f} MB)")
    return SUCCESS


def _page(result: str, out: str | None) -> Path:
    """Where the page goes.

    Raises
    ------
    InputError
        The path is that of a folder, or its folder may not be written to.
    """
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.problems import InputError, Problem
    from tdcr_fe.io.tables import VIEW_PAGE

    path = Path(result) / VIEW_PAGE if out is None else Path(out)
    if path.is_dir() or path.suffix.lower() not in (".html", ".htm"):
        raise InputError([Problem("-o", "", str(path), "must be a file that ends in .html")])
    check_output_folder(path.parent)
    return path
