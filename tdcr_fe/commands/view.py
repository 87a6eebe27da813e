"""The command ``tdcr-fe view``: a folder of results as an interactive 3D page, and as video or geometry files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.common import SUCCESS, add_options, count, progress_bar

if TYPE_CHECKING:
    from tdcr_fe.report.motion import Motion


def add_view_parser(commands: Any) -> None:
    """Add ``tdcr-fe view``."""
    parser = commands.add_parser(
        "view",
        help="draw results in 3D, as one HTML file",
        description="Write one HTML file with the robot in 3D, a slider over the load steps, and plots that follow it. "
        "It opens in a browser without a server and without a network.",
    )
    option = parser.add_argument
    option("result", metavar="RESULT", help="folder that tdcr-fe run, follow or identify wrote")
    option("-o", "--out", metavar="FILE.html", help="the page [RESULT/view.html]")
    option(
        "--video",
        metavar="FILE",
        help="also a video, FILE.gif or FILE.mp4 (the latter needs the program ffmpeg)",
    )
    option(
        "--vtk",
        metavar="FOLDER",
        help="also files for ParaView: FOLDER/robot.pvd and one .vtp for each load step",
    )
    option(
        "--gltf", metavar="FILE.glb", help="also an animated 3D model, for Blender, slides and other viewers"
    )
    add_options(parser)
    parser.set_defaults(handler=view)


def view(args: argparse.Namespace) -> int:
    """Read the results and write the page, and what else was asked for."""
    from tdcr_fe.io.atomic import check_output_folder, write_text
    from tdcr_fe.io.result_folder import read_motion
    from tdcr_fe.report.viewer import summary, view_page

    out = _page(args.result, args.out)
    video = None if args.video is None else _video(args.video)
    model = None if args.gltf is None else _file(args.gltf, (".glb",), "--gltf")
    if args.vtk is not None:
        check_output_folder(args.vtk)
    motion = read_motion(args.result)
    write_text(view_page(motion), out)
    say = (lambda text: None) if args.quiet else print
    say(f"{motion.name}: {summary(motion)}. Written: {out} ({out.stat().st_size / 1e6:.2f} MB)")
    if args.vtk is not None:
        from tdcr_fe.io.vtk_files import write_vtk

        written = write_vtk(motion, args.vtk)
        say(f"Written: {written[0].parent / 'robot.pvd'} and {count(len(written) - 1, 'file')} beside it")
    if model is not None:
        from tdcr_fe.io.gltf import write_glb

        write_glb(motion, model)
        say(f"Written: {model} ({model.stat().st_size / 1e6:.2f} MB)")
    if video is not None:
        _write_video(motion, video, args)
        say(f"Written: {video} ({video.stat().st_size / 1e6:.2f} MB)")
    return SUCCESS


def _video(path: str) -> Path:
    """Where the video goes; refused before anything is written."""
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.problems import InputError, Problem
    from tdcr_fe.report.video import problem

    reason = "is a directory; must be a file" if Path(path).is_dir() else problem(Path(path))
    if reason:
        raise InputError([Problem("--video", "", path, reason)])
    check_output_folder(Path(path).parent)
    return Path(path)


def _write_video(motion: Motion, path: Path, args: argparse.Namespace) -> None:
    """Write the video with a bar on stderr, where that is a terminal."""
    from tdcr_fe.report.video import write_video

    with progress_bar(args, 100) as bar:

        def progress(share: float) -> None:
            bar.update(int(100 * share) - bar.n)

        write_video(motion, path, progress)


def _page(result: str, out: str | None) -> Path:
    """Where the page goes."""
    from tdcr_fe.io.result_files import VIEW_PAGE

    return _file(str(Path(result) / VIEW_PAGE) if out is None else out, (".html", ".htm"), "-o")


def _file(path: str, endings: tuple[str, ...], option: str) -> Path:
    """A file that is to be written.

    Raises
    ------
    InputError
        The path is that of a folder, has another ending, or its folder may not be written to.
    """
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.problems import InputError, Problem

    if Path(path).is_dir() or Path(path).suffix.lower() not in endings:
        raise InputError([Problem(option, "", path, f"must be a file that ends in {endings[0]}")])
    check_output_folder(Path(path).parent)
    return Path(path)
