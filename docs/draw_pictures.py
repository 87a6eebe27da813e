"""Draw the pictures of the pages anew, those of the paper left out: ``python docs/draw_pictures.py``.

Those of "A first robot" and of the README are the pictures of ``tdcr-fe demo``.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from tdcr_fe import cli

DOCS = Path(__file__).parent
#: Pictures of the demo, and their width on the page [pixels].
OF_THE_DEMO = {"shapes": 1018, "tensions": 680, "hysteresis": 640}
#: Examples that draw a picture.
OF_EXAMPLES = ("robot_on_ground", "robot_on_carriage", "sensitivities", "inverse_statics")


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


def draw_examples(folder: Path) -> None:
    """Run the examples that draw a picture."""
    for name in OF_EXAMPLES:
        example = DOCS / "examples" / f"{name}.py"
        subprocess.run([sys.executable, str(example), str(folder / f"{name}.png")], check=True)


if __name__ == "__main__":
    draw_demo(DOCS / "pictures")
    draw_examples(DOCS / "pictures")
