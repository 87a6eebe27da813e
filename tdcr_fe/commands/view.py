"""The command ``tdcr-fe view``: a folder of results as an interactive 3D page, and as video or geometry files."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from tdcr_fe.commands.common import Exit, progress_bar, say
from tdcr_fe.io.files import check_output_folder, read_all, refusal, write_text
from tdcr_fe.io.result_files import VIEW_PAGE
from tdcr_fe.io.result_folder import read_motion, write_vtk
from tdcr_fe.model.messages import count
from tdcr_fe.report import video
from tdcr_fe.report.viewer import summary, view_page


def view(args: argparse.Namespace) -> int:
    """Read the results and write the page, and what else was asked for."""
    page = args.out or str(Path(args.result) / VIEW_PAGE)
    motion, out, film, _ = read_all(
        lambda: read_motion(args.result),
        lambda: _file("-o", page, _problem_of_page),
        lambda: args.video and _file("--video", args.video, video.problem),
        lambda: args.vtk and check_output_folder(args.vtk, "--vtk"),
    )
    write_text(view_page(motion), out)
    args.noted.files.append(out)
    say(args, f"{motion.name}: {summary(motion)}. Written: {_sized(out)}")
    if args.vtk:
        written = write_vtk(motion, args.vtk)
        files = count(len(written) - 1, "file")
        say(args, f"Written: {written[0].parent / 'robot.pvd'} and {files} next to it")
    if film:
        with progress_bar(args, 100) as bar:
            video.write_video(motion, film, lambda share: bar.update(int(100 * share) - bar.n))
        say(args, f"Written: {_sized(film)}")
    return Exit.DONE


def _sized(path: Path) -> str:
    return f"{path} ({path.stat().st_size / 1e6:.2f} MB)"


def _file(option: str, text: str, problem: Callable[[Path], str]) -> Path:
    """A file that is to be written; refused before anything is.

    Raises
    ------
    InputError
        The path is that of a folder or has another ending, or its folder may not be written to.
    """
    path = Path(text)
    reason = "is a directory; must be a file" if path.is_dir() else problem(path)
    if reason:
        raise refusal(option, reason, value=text)
    check_output_folder(path.parent, option)
    return path


def _problem_of_page(path: Path) -> str:
    return "" if path.suffix.lower() in (".html", ".htm") else "must be a file that ends in .html"
