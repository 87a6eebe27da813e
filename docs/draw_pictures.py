"""Draw the pictures of the pages anew, those of the paper left out: ``python docs/draw_pictures.py``.

Those of "A first robot" and of the README are the pictures of ``tdcr-fe demo``. The gallery draws its own, and those of
the pages that show an example, when the pages are built.
"""

import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from tdcr_fe import cli

DOCS = Path(__file__).parent
#: Pictures of the demo, and their width on the page [pixels].
OF_THE_DEMO = {"shapes": 1018, "tensions": 680, "hysteresis": 640}


def draw_demo(folder: Path) -> None:
    """Run the demo and write its pictures, small enough for a page."""
    with TemporaryDirectory() as out:
        if cli.main(["demo", "-o", out, "--quiet"]) != 0:
            raise SystemExit("the demo did not converge")
        for name, width in OF_THE_DEMO.items():
            with Image.open(Path(out) / f"{name}.png") as picture:
                size = (width, round(width * picture.height / picture.width))
                page = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
            page.quantize(128).save(folder / f"{name}.png")


def draw_moving_robot(folder: Path) -> None:
    """Write `robot.gif`, the motion of the demo, and `pages/robot_in_3d.html`, the same in 3D, if missing."""
    moving, page = folder / "robot.gif", folder / "pages" / "robot_in_3d.html"
    if moving.exists() and page.exists():
        return
    page.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as out:
        if cli.main(["demo", "-o", out, "--quiet"]) != 0:
            raise SystemExit("the demo did not converge")
        if cli.main(["view", out, "-o", str(page), "--video", str(moving), "--quiet"]) != 0:
            raise SystemExit("the demo could not be drawn")


def draw_viewer(folder: Path) -> None:
    """Photograph the 3D page of the demo in a headless Chromium, where there is one."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("viewer.png stays as it is: no Chromium found")
        return
    with TemporaryDirectory() as out:
        if cli.main(["demo", "-o", out, "--quiet"]) != 0:
            raise SystemExit("the demo did not converge")
        photo = Path(out) / "photo.png"
        flags = ["--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader"]
        flags += ["--enable-unsafe-swiftshader", "--window-size=1360,850", "--virtual-time-budget=4000"]
        page = (Path(out) / "view.html").as_uri()
        subprocess.run(
            [chromium, *flags, f"--user-data-dir={out}/profile", f"--screenshot={photo}", page], check=True
        )
        with Image.open(photo) as picture:
            part = picture.convert("RGB").crop((0, 0, 1360, 752))
            part.resize((1020, 564), Image.Resampling.LANCZOS).save(folder / "viewer.png", optimize=True)


def draw_sweeps(folder: Path) -> None:
    """Run the sweeps of the page "Sweeps" and keep the pictures of their reports."""
    kept = {
        "uncertainty": {"sobol_indices": "sweep_sobol", "distributions": "sweep_distributions"},
        "workspace": {"workspace": "sweep_workspace"},
    }
    for name, pictures in kept.items():
        with TemporaryDirectory() as out:
            if cli.main(["sweep", str(DOCS / "examples" / "sweeps" / f"{name}.toml"), "-o", out, "-q"]) != 0:
                raise SystemExit(f"a case of {name}.toml did not converge")
            for source, target in pictures.items():
                with Image.open(Path(out) / f"{source}.png") as picture:
                    size = (1018, round(1018 * picture.height / picture.width))
                    page = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
                page.quantize(128).save(folder / f"{target}.png")


if __name__ == "__main__":
    draw_demo(DOCS / "pictures")
    draw_viewer(DOCS / "pictures")
    draw_sweeps(DOCS / "pictures")
