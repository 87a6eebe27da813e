"""The jinja2 environment of all reports, and the filters that turn numbers into text."""

from __future__ import annotations

import math
import re
from functools import cache

import jinja2

DASH, MINUS, SPACE = "–", "−", "\N{NO-BREAK SPACE}"

#: Factor and symbol in which a unit is shown; others are shown as in "N m²/s" for "N m^2 s^-1".
_SHOWN = {"rad": (math.degrees(1.0), "deg"), "kg": (1e3, "g"), "1": (1.0, "")}
#: Units that take SI prefixes (after the change above), and the prefixes.
_PREFIXED = {"m", "N", "N m", "s", "g", "N/m", "N m²"}
_PREFIXES = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"), (1.0, ""), (1e3, "k"), (1e6, "M"))


def _signed(text: str) -> str:
    return text.replace("-", MINUS)


def significant(value: float | None, digits: int = 3) -> str:
    """A number with some significant digits, below 100,000 without an exponent; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value + 0.0:.{digits}g}"
    return _signed(f"{float(text):.0f}" if "e+" in text and int(text[-2:]) < 5 else text)


def fixed(value: float | None, decimals: int = 2) -> str:
    """A number with fixed decimals; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    return _signed(f"{round(value, decimals) + 0.0:.{decimals}f}")


def shown_unit(unit: str, size: float) -> tuple[float, str]:
    """Factor and symbol in which a quantity of that unit and size is shown.

    Parameters
    ----------
    unit
        SI unit, as in the files.
    size
        Magnitude by which the prefix is chosen: a length of 0.02 m is shown in mm.

    Returns
    -------
    (float, str)
        What to multiply with, and the symbol.
    """
    symbol = re.sub(r" (\w+)\^-", r"/\1^", unit).replace("^1", "").replace("^2", "²").replace("^3", "³")
    factor, symbol = _SHOWN.get(unit, (1.0, symbol))
    size = abs(size) * factor
    if symbol not in _PREFIXED or size == 0.0 or not math.isfinite(size):
        return factor, symbol
    # A thousandth of a unit is already shown with the smaller prefix; 0.25 m reads as 250 mm.
    prefixes = [p for p in _PREFIXES if symbol not in ("m", "s", "g") or p[0] <= 1.0]
    scale, prefix = next((p for p in reversed(prefixes) if size >= p[0]), prefixes[0])
    return factor / scale, prefix + symbol


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """A number with its unit and an SI prefix: 0.0188 m becomes "18.8 mm"; radians become degrees."""
    if value is None or not math.isfinite(value):
        return DASH
    factor, symbol = shown_unit(unit, value)
    return significant(value * factor, digits) + (SPACE + symbol if symbol else "")


def estimate(value: float, half_width: float | None, unit: str) -> str:
    """A number with the half-width of its interval, both to the last significant digit; small ones with an exponent.

    Parameters
    ----------
    value
        In SI units.
    half_width
        Half-width of an interval about it; None where there is none.
    unit
        SI unit, as in the files.
    """
    if half_width is None or not math.isfinite(half_width) or half_width <= 0.0 or not math.isfinite(value):
        return quantity(value, unit, 4)
    size = max(abs(value), half_width)
    factor, symbol = shown_unit(unit, size)
    power = math.floor(math.log10(factor * size))
    power = power if power < -4 else 0
    value, half_width = (x * factor / 10.0**power for x in (value, half_width))
    decimals = max(0, 1 - math.floor(math.log10(half_width)))
    text = f"{fixed(value, decimals)} ± {fixed(half_width, decimals)}"
    return (f"({text})e{power}" if power else text) + (SPACE + symbol if symbol else "")


def words(name: str) -> str:
    """A name of a file format as words: ``tip_payload`` becomes "tip payload"."""
    return name.replace("_", " ")


@cache
def environment(package: str = __package__) -> jinja2.Environment:
    """Templates of a package (its folder ``templates``), then those of this one, with the shared filters.

    Parameters
    ----------
    package
        Full name of an importable package.
    """
    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(p) for p in (package, __package__)]),
        autoescape=lambda name: bool(name and name.endswith(".html.j2")),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # of `tojson`, which writes data into a script
    made.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    made.filters.update({f.__name__: f for f in (significant, fixed, quantity, words)})
    return made
