"""Unit, bounds and description of a field, and the mistake of a value that is not allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple


class Mistake(NamedTuple):
    """One value that is not allowed.

    Attributes
    ----------
    key : str
        Dotted, as in the files.
    value : Any
        What was given.
    allowed : str
        What is allowed instead.
    wrong_type : bool
        Whether a value of another type is needed.
    """

    key: str
    value: Any
    allowed: str
    wrong_type: bool = False


@dataclass(frozen=True)
class Quantity:
    """Unit, bounds and description of a field; the metadata of ``Annotated``.

    Attributes
    ----------
    description : str
        What it is, for documentation and editors.
    unit : str
        Of every number in it; empty where there is none.
    gt, ge, lt, le : float or None
        Bounds of every number in it.
    allowed : str
        What is allowed, as text; replaces the one made from type, unit and bounds.
    note : str
        Added to that sentence.
    name : bool
        Whether a text must be a name: printable, not empty, without blanks at its ends.
    min_items : int
        Fewest items of a sequence.
    in_file : bool
        Whether the field is a key of the file; otherwise it follows from others.
    infinite : bool
        Whether infinity is allowed.
    variants : mapping of str to type, or None
        Classes of which the value is one, by the name that the key ``kind`` of its table gives.
    """

    description: str
    unit: str = ""
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    allowed: str = ""
    note: str = ""
    name: bool = False
    min_items: int = 0
    in_file: bool = True
    infinite: bool = False
    variants: Mapping[str, type] | None = None

    def holds(self, value: float) -> bool:
        """Whether a finite number is within the bounds."""
        return (
            (self.gt is None or value > self.gt)
            and (self.ge is None or value >= self.ge)
            and (self.lt is None or value < self.lt)
            and (self.le is None or value <= self.le)
        )

    def range_text(self, noun: str, unit: str) -> str:
        """Noun, unit and bounds in words, such as "a positive number [m], at most 10"."""
        lower, upper = (
            self.gt if self.gt is not None else self.ge,
            self.lt if self.lt is not None else self.le,
        )
        unit = f" [{unit}]" if unit else ""
        article = "a " if not noun.endswith("s") else ""
        if lower is None and upper is None:
            return f"{article}finite {noun}{unit}"
        if lower is None:
            return f"{article}{noun}{unit}, {'below' if self.lt is not None else 'at most'} {upper:g}"
        if upper is not None and lower != 0.0:
            first = f"above {lower:g}" if self.gt is not None else f"from {lower:g}"
            second = (
                f"below {upper:g}" if self.lt is not None else f"{'up ' * (self.gt is not None)}to {upper:g}"
            )
            return f"{article}{noun}{unit} {first}{',' if self.gt is not None else ''} {second}"
        if lower == 0.0:
            text = (
                f"{article}positive {noun}{unit}"
                if self.gt is not None
                else f"{article}{noun}{unit}, zero or more"
            )
        else:
            text = f"{article}{noun}{unit} {'above' if self.gt is not None else 'from'} {lower:g}"
        if upper is None:
            return text
        return f"{text}, {'below' if self.lt is not None else 'at most'} {upper:g}"


class FieldError(ValueError):
    """A value of a field does not fit the rest of the description.

    Attributes
    ----------
    field, value, allowed : str
    """

    def __init__(self, field: str, value: str, allowed: str) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        super().__init__(f"{field} = {value}: {allowed}")
