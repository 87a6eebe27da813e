"""The command ``tdcr-fe view``: a folder of results as an interactive 3D page, and as video or geometry files."""

from __future__ import annotations

import argparse
from pathlib import Path

from tdcr_fe.commands.common import Exit, progress_bar
from tdcr_fe.io.atomic import check_output_folder, write_text
from tdcr_fe.io.problems import refusal
from tdcr_fe.io.result_files import VIEW_PAGE
from tdcr_fe.io.result_folder import read_motion
from tdcr_fe.io.vtk_files import write_vtk
from tdcr_fe.model.messages import count
from tdcr_fe.report import video
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer import summary, view_page


def view(args: argparse.Namespace) -> int:
    """Read the results and write the page, and what else was asked for."""
    motion = read_motion(args.result)
    out = _file(args.out or str(Path(args.result) / VIEW_PAGE), (".html", ".htm"), "-o")
    film = None if args.video is None else _video(args.video)
    if args.vtk is not None:
        check_output_folder(args.vtk)
    write_text(view_page(motion), out)
    say = (lambda text: None) if args.quiet else print
    say(f"{motion.name}: {summary(motion)}. Written: {_sized(out)}")
    if args.vtk is not None:
        written = write_vtk(motion, args.vtk)
        say(f"Written: {written[0].parent / 'robot.pvd'} and {count(len(written) - 1, 'file')} next to it")
    if film is not None:
        _write_video(motion, film, args)
        say(f"Written: {_sized(film)}")
    return Exit.DONE


def _sized(path: Path) -> str:
    return f"{path} ({path.stat().st_size / 1e6:.2f} MB)"


def _video(path: str) -> Path:
    """Where the video goes; refused before anything is written."""
    reason = "is a directory; must be a file" if Path(path).is_dir() else video.problem(Path(path))
    if reason:
        raise refusal("--video", reason, value=path)
    check_output_folder(Path(path).parent)
    return Path(path)


def _write_video(motion: Motion, path: Path, args: argparse.Namespace) -> None:
    """Write the video with a bar on stderr, where that is a terminal."""
    with progress_bar(args, 100) as bar:

        def progress(share: float) -> None:
            bar.update(int(100 * share) - bar.n)

        video.write_video(motion, path, progress)


def _file(path: str, endings: tuple[str, ...], option: str) -> Path:
    """A file that is to be written.

    Raises
    ------
    InputError
        The path is that of a folder, has another ending, or its folder may not be written to.
    """
    if Path(path).is_dir() or Path(path).suffix.lower() not in endings:
        raise refusal(option, f"must be a file that ends in {endings[0]}", value=path)
    check_output_folder(Path(path).parent)
    return Path(path)
