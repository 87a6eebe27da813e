"""Units that a value may be given in: from a text such as "250 mm" to a number in the unit of its key."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import Any

from tdcr_fe.model.messages import meant

_TURN = 2 * Fraction(math.pi)
#: Units by what they measure: exponents of m, kg and s, and the size of each in SI. Angles are ratios.
_UNITS: dict[tuple[int, ...], dict[str, Fraction | str]] = {
    (1, 0, 0): {"m": "1", "cm": "1e-2", "mm": "1e-3", "um": "1e-6", "in": "0.0254", "ft": "0.3048"},
    (0, 1, 0): {"kg": "1", "g": "1e-3", "mg": "1e-6"},
    (0, 0, 1): {"s": "1", "ms": "1e-3", "min": "60", "h": "3600"},
    (1, 1, -2): {"N": "1", "mN": "1e-3", "kN": "1e3", "gf": "9.80665e-3", "kgf": "9.80665"},
    (2, 1, -2): {"Nm": "1", "Nmm": "1e-3"},
    (-1, 1, -2): {"Pa": "1", "kPa": "1e3", "MPa": "1e6", "GPa": "1e9"},
    (0, 0, 0): {"rad": "1", "mrad": "1e-3", "deg": _TURN / 360, "turns": _TURN, "1": "1"},
}
#: Units that numbers are often given in by mistake, by the unit that they should be in.
_MISTAKEN = {
    "m": ("mm", "cm"), "N": ("mN", "gf", "kN"), "N m": ("N mm",), "N m^2": ("N mm^2",), "kg": ("g",),
    "Pa": ("GPa", "MPa", "kPa"), "kg/m^3": ("g/cm^3", "g/mm^3", "g/m^3"), "m/s^2": ("mm/s^2", "cm/s^2", "ft/s^2"),
    "1/m": ("1/mm",), "N/m": ("N/mm",), "N m/rad": ("N mm/rad",), "deg": ("rad",), "rad": ("deg",), "turns": ("deg",),
}  # fmt: skip
_KNOWN = {name: (dimension, Fraction(size)) for dimension, of in _UNITS.items() for name, size in of.items()}
_NUMBER = r"[+-]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][+-]?[0-9]{1,3})?"
#: Of texts with a number and a unit.
PATTERN = rf"^\s*({_NUMBER})\s*([^\s0-9.,+-].*|1/.+)$"
#: Other ways to write a unit.
_SPELLINGS = str.maketrans({"²": "^2", "³": "^3", "·": " ", "*": " ", "µ": "u", "μ": "u", "°": "deg"})


class UnitError(ValueError):
    """A text is no number with a unit of the kind that is needed; the message says why, or is empty."""


def has_unit(unit: str) -> bool:
    """Whether values of this unit may be texts; not those without one."""
    return unit not in ("", "1")


def number_of(text: str, unit: str) -> float:
    """The number of a text such as "250 mm", in ``unit``.

    Raises
    ------
    UnitError
        The text is no number with a unit, or its unit cannot be converted.
    """
    found = re.match(PATTERN, text)
    if found is None:
        is_number = re.fullmatch(rf"\s*{_NUMBER}\s*", text)
        hint = f"without quotes it is in {unit}" if is_number else ""
        raise UnitError("write a decimal point" if re.match(r"\s*[+-]?[0-9]*,[0-9]", text) else hint)
    number, given = found.groups()
    (dimension, size), (needed, target) = _measure(given), _measure(unit)
    if dimension != needed:
        raise UnitError(f"{given.strip()} cannot be converted to {unit}")
    try:
        return float(Fraction(number) * size / target)
    except OverflowError:
        return math.inf


def mistaken(unit: str) -> dict[str, float]:
    """Units that numbers are often given in by mistake, and their size in ``unit``."""
    sizes = {other: number_of(f"1 {other}", unit) for other in _MISTAKEN.get(unit, ())}
    return sizes if unit else {"%": 0.01}


def number_or_none(value: Any, unit: str) -> float | None:
    """A value of a file as a number in ``unit``; None where it is none."""
    try:
        value = number_of(value, unit) if isinstance(value, str) and has_unit(unit) else value
    except UnitError:
        return None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _measure(unit: str) -> tuple[tuple[int, ...], Fraction]:
    """Dimension and size of a product of units, such as "N m^2" or "kg/m^3"."""
    dimension: tuple[int, ...] = (0, 0, 0)
    size = Fraction(1)
    for k, product in enumerate(unit.translate(_SPELLINGS).split("/")):
        for factor in product.split():
            name, _, power = factor.partition("^")
            if name not in _KNOWN or power not in ("", "1", "2", "3", "4"):
                same = [x for x in _KNOWN if x.lower() == name.lower()]
                hint = f"; did you mean {same[0]}?" if same else meant(name, _KNOWN)
                raise UnitError(f"unknown unit {factor}{hint}")
            exponent = int(power or 1) * (-1 if k else 1)
            of_one, one = _KNOWN[name]
            dimension = tuple(a + exponent * b for a, b in zip(dimension, of_one, strict=True))
            size *= one**exponent
    return dimension, size


def with_units(allowed: str, text: str, unit: str) -> str:
    """What is allowed in place of a text, with the units that it may have, and why it cannot be read."""
    if not has_unit(unit):
        return allowed
    others = [x for x in _UNITS.get(_measure(unit)[0], ()) if x.isalpha()]
    units = ", ".join(others) if others else f"such as {unit}"
    try:
        number_of(text, unit)
    except UnitError as error:
        reason = f"; {error}" if str(error) else ""
        return f"{allowed}, or a number with its unit in quotes ({units}){reason}"
    return allowed
