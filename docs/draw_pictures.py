"""Draw the pictures of the pages, when these are built: those of the demo and of the page "Sweeps".

The gallery draws its own. ``python docs/draw_pictures.py`` draws the picture of the README anew.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from tdcr_fe import cli

DOCS = Path(__file__).parent
#: Pictures of the demo, and their width on the page [pixels].
OF_THE_DEMO = {"shapes": 1018, "tensions": 680, "hysteresis": 640}
#: Pictures of the sweeps in `examples/sweeps`: file of the report, and name on the page.
OF_THE_SWEEPS = {
    "uncertainty": {"sobol_indices": "sweep_sobol", "distributions": "sweep_distributions"},
    "workspace": {"workspace": "sweep_workspace"},
}
#: Picture of the README.
OF_THE_README = DOCS / "pictures" / "shapes.png"


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


def draw_sweeps(folder: Path) -> None:
    """Run the sweeps of the page "Sweeps" and keep the pictures of their reports."""
    for name, pictures in OF_THE_SWEEPS.items():
        with TemporaryDirectory() as out:
            if cli.main(["sweep", str(DOCS / "examples" / "sweeps" / f"{name}.toml"), "-o", out, "-q"]) != 0:
                raise SystemExit(f"a case of {name}.toml did not converge")
            for source, target in pictures.items():
                with Image.open(Path(out) / f"{source}.png") as picture:
                    size = (1018, round(1018 * picture.height / picture.width))
                    page = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
                page.quantize(128).save(folder / f"{target}.png")


def draw_missing(folder: Path) -> None:
    """Draw the pictures of the demo and of the sweeps that are not in a folder yet."""
    folder.mkdir(parents=True, exist_ok=True)
    if not all((folder / f"{name}.png").exists() for name in OF_THE_DEMO):
        draw_demo(folder)
    if not all(
        (folder / f"{name}.png").exists() for names in OF_THE_SWEEPS.values() for name in names.values()
    ):
        draw_sweeps(folder)


if __name__ == "__main__":
    with TemporaryDirectory() as drawn:
        draw_demo(Path(drawn))
        OF_THE_README.write_bytes((Path(drawn) / OF_THE_README.name).read_bytes())
