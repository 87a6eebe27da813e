"""The command ``tdcr-fe live``: a page on this computer, on which a robot answers sliders and the mouse."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from tdcr_fe.commands.common import Exit, complain
from tdcr_fe.io.files import refusal
from tdcr_fe.io.toml import read_model_file, read_robot
from tdcr_fe.live import LiveRobot
from tdcr_fe.live.played import PlayedRobot
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.load_steps.load_path import StepFailed


def live(args: argparse.Namespace) -> int:
    """Serve the page until it is closed, or until Ctrl-C."""
    robot = read_robot(args.robot)
    model, settings = read_model_file(args.model, robot)
    quick = None if settings == SolverSettings() else settings
    try:
        page = LiveRobot(PlayedRobot(robot, model, quick), args.port, Path(args.robot).name)
    except OSError as error:
        raise refusal("--port", f"cannot be used: {error.strerror or error}", value=str(args.port)) from error
    except StepFailed as failure:
        complain(f"the unloaded robot is not solved: {failure}")
        return Exit.FAILED
    if args.no_browser or not args.quiet:  # nobody could guess the address
        print(f"{robot.name} is live at {page.url}\nClosing the page or Ctrl-C ends it.", flush=True)
    if not args.no_browser:
        webbrowser.open(page.url)
    try:
        page.wait_until_closed()
    except KeyboardInterrupt:
        complain("interrupted; the page stays as it is")
        return Exit.INTERRUPTED
    finally:
        page.close()
    return Exit.DONE
