"""Bounds, units and descriptions as annotations of dataclass fields, checked for Python objects and files.

A field such as ``length: Annotated[float, Quantity("from base plate to tip", unit="m", gt=0.0)]`` is checked by
`check_fields` when the object is made, by `tdcr_fe.io.toml` when a file is read, and described by
`tdcr_fe.io.json_schema`.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Annotated, Any, Literal

import numpy as np

from tdcr_fe.model.quantity import Mistake, Quantity
from tdcr_fe.model.wording import join, meant, shown

#: Marks a field without a default.
REQUIRED: Any = object()

_WORDS = {1: "one", 2: "two", 3: "three"}


#: Takes each mistake.
Note = Callable[[Mistake], None]


class Kind:
    """Type of a field: checks values, names what is allowed, and describes itself as JSON schema."""

    def allowed(self, q: Quantity) -> str:
        """What is allowed, as a sentence without "must be"."""
        raise NotImplementedError

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """The value in its normal form; every mistake in it is noted.

        Parameters
        ----------
        value, key
            What is given, and its dotted key.
        q
            Bounds and description of the field.
        note
            Takes each mistake.
        from_file
            Whether objects are given as tables.
        """
        raise NotImplementedError

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """JSON schema of one value."""
        raise NotImplementedError

    def options(self) -> tuple[str, ...]:
        """Texts that it takes, where there are few."""
        return ()

    def refuse(self, value: Any, key: str, q: Quantity, note: Note, wrong_type: bool) -> Any:
        """Note a mistake; gives the value back."""
        hint = meant(value, self.options()) if isinstance(value, str) else ""
        note(Mistake(key, value, f"must be {q.allowed or self.allowed(q)}{hint}", wrong_type))
        return value


class Number(Kind):
    """A finite floating-point number; whole numbers are taken as such, truth values are not."""

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        return q.range_text("number", q.unit) + (f", {q.note}" if q.note else "")

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if type(value) is not float:
            if isinstance(value, bool) or not isinstance(value, Real):
                return self.refuse(value, key, q, note, True)
            try:
                number = float(value)
            except OverflowError:
                return self.refuse(value, key, q, note, False)
        else:
            number = value
        if not (math.isfinite(number) or (q.infinite and number == math.inf)) or not q.holds(number):
            return self.refuse(value, key, q, note, False)
        return number

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"type": "number", **_json_bounds(q)}


class Whole(Kind):
    """A whole number."""

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        return q.range_text("whole number", q.unit) + (f", {q.note}" if q.note else "")

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if type(value) is not int:
            if isinstance(value, bool) or not isinstance(value, Integral):
                return self.refuse(value, key, q, note, True)
            value = int(value)
        return value if q.holds(value) else self.refuse(value, key, q, note, False)

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"type": "integer", **_json_bounds(q)}


class Text(Kind):
    """A text; with ``name`` one that can be a name in tables."""

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        if q.name:
            return "a name in quotes: not empty, printable, no blanks at its ends"
        return "a text in quotes"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if not isinstance(value, str):
            return self.refuse(value, key, q, note, True)
        if q.name and (not value.strip() or value != value.strip() or not value.isprintable()):
            return self.refuse(value, key, q, note, False)
        return value

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"type": "string", **({"minLength": 1} if q.name else {})}


@dataclass(frozen=True)
class Choice(Kind):
    """One of a few texts."""

    texts: tuple[str, ...]

    def options(self) -> tuple[str, ...]:
        """See `Kind.options`."""
        return self.texts

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        texts = [f'"{o}"' for o in self.texts]
        return texts[0] if len(texts) == 1 else ", ".join(texts[:-1]) + f" or {texts[-1]}"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if not isinstance(value, str):
            return self.refuse(value, key, q, note, True)
        return value if value in self.texts else self.refuse(value, key, q, note, False)

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"enum": list(self.texts)}


@dataclass(frozen=True)
class OneOf(Kind):
    """One of a few texts, or a value of another kind."""

    choice: Choice
    others: tuple[Kind, ...]

    def options(self) -> tuple[str, ...]:
        """See `Kind.options`."""
        return self.choice.texts

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        return f"{self.choice.allowed(q)} or {self.others[0].allowed(q)}"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if isinstance(value, str) and value in self.choice.texts:
            return value
        wrong_type = True
        for kind in self.others:
            found: list[Mistake] = []
            taken = kind.take(value, key, q, found.append, from_file)
            if not found:
                return taken
            wrong_type &= found[0].wrong_type
        return self.refuse(value, key, q, note, wrong_type)

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"anyOf": [kind.json_schema(q) for kind in (self.choice, *self.others)]}


@dataclass(frozen=True)
class Items(Kind):
    """A sequence of values of one kind, of a fixed count or any."""

    item: Kind
    count: int | None = None

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        if isinstance(self.item, Table):
            return f"a list of tables with {', '.join(fields_of(self.item.cls))}"
        if isinstance(self.item, Items):
            return f"a list of lists, each {self.item.allowed(q)}"
        numbers = q.range_text("numbers", q.unit)
        text = (
            f"{_WORDS.get(self.count, str(self.count))} {numbers}" if self.count else f"a list of {numbers}"
        )
        return text + (f", {q.note}" if q.note else "")

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if isinstance(value, np.ndarray) and value.ndim:
            value = value.tolist()
        if not isinstance(value, list | tuple):
            if isinstance(self.item, Table) and not from_file:
                note(Mistake(key, value, f"must be a sequence of {self.item.cls.__name__}", True))
                return value
            return self.refuse(value, key, q, note, True)
        if len(value) < q.min_items or (self.count is not None and len(value) != self.count):
            return self.refuse(value, key, q, note, False)
        if isinstance(self.item, Number):
            fast = tuple(value)
            if all(type(x) is float and math.isfinite(x) and q.holds(x) for x in fast):
                return value if value is fast else fast
        # Each item is named, with what is allowed for the whole.
        whole = q if q.allowed else dataclasses.replace(q, allowed=self.allowed(q))
        if isinstance(self.item, Table):
            whole = q
        return tuple(self.item.take(x, f"{key}[{i}]", whole, note, from_file) for i, x in enumerate(value))

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        schema: dict[str, Any] = {"type": "array", "items": self.item.json_schema(q)}
        least = self.count or q.min_items
        return {
            **schema,
            **({"minItems": least} if least else {}),
            **({"maxItems": self.count} if self.count else {}),
        }


@dataclass(frozen=True)
class ByName(Kind):
    """A mapping from names to values of one kind."""

    item: Kind

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        if isinstance(self.item, Table):
            return f"a table of tables by name, each with {', '.join(fields_of(self.item.cls))}"
        return f"a table of values by name, each {self.item.allowed(q)}"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if not isinstance(value, Mapping):
            return self.refuse(value, key, q, note, True)
        changed = {}
        for name, x in value.items():
            if not isinstance(name, str):
                self.refuse(name, f"{key} (a key)", q, note, True)
                continue
            changed[name] = self.item.take(x, join(key, name), q, note, from_file)
        return changed

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return {"type": "object", "additionalProperties": self.item.json_schema(q)}


@dataclass(frozen=True)
class Table(Kind):
    """An object of a dataclass; in a file a table of its fields."""

    cls: type

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        return f"a table with {', '.join(fields_of(self.cls))}"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`."""
        if not from_file:
            if not isinstance(value, self.cls):
                note(Mistake(key, value, f"must be of type {self.cls.__name__}", True))
            return value
        found: list[Mistake] = []
        values, _ = take_table(fields_of(self.cls), value, key, found.append)
        if not found:
            try:
                return self.cls(**values)
            except ValueError as error:  # fields that do not fit together
                found.append(Mistake(key, value, str(error)))
        for mistake in found:
            note(mistake)
        return None

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        return table_schema(fields_of(self.cls))


@dataclass(frozen=True)
class Variant(Kind):
    """An object of one of several dataclasses; in a file a table whose key ``kind`` names it."""

    def allowed(self, q: Quantity) -> str:
        """See `Kind.allowed`."""
        names = ", ".join(f'"{name}"' for name in q.variants or {})
        return f"a table with kind (one of {names}) and the keys of that kind"

    def take(self, value: Any, key: str, q: Quantity, note: Note, from_file: bool) -> Any:
        """See `Kind.take`; in Python any object with a ``kind`` will do."""
        variants = q.variants or {}
        if not from_file:
            if not isinstance(getattr(value, "kind", None), str):
                names = ", ".join(cls.__name__ for cls in variants.values())
                note(Mistake(key, value, f"must be one of {names}, or another law with a kind", True))
            return value
        if not isinstance(value, dict):
            return self.refuse(value, key, q, note, True)
        kind = value.get("kind")
        if not isinstance(kind, str) or kind not in variants:
            names = ", ".join(f'"{name}"' for name in variants)
            hint = meant(kind, variants) if isinstance(kind, str) else ""
            given = value.get("kind", REQUIRED)
            text = f"{'missing; ' if given is REQUIRED else ''}must be one of {names}{hint}"
            note(Mistake(join(key, "kind"), given, text, True))
            return value
        rest = {k: v for k, v in value.items() if k != "kind"}
        return Table(variants[kind]).take(rest, key, q, note, True)

    def json_schema(self, q: Quantity) -> dict[str, Any]:
        """See `Kind.json_schema`."""
        options = []
        for name, cls in (q.variants or {}).items():
            schema = table_schema(fields_of(cls))
            schema["properties"] = {"kind": {"const": name}, **schema["properties"]}
            schema["required"] = ["kind", *schema.get("required", [])]
            options.append(schema)
        return {"type": "object", "oneOf": options}


@dataclass(frozen=True)
class Field:
    """A field of a dataclass, or a key of a table.

    Attributes
    ----------
    name : str
    kind : Kind
    quantity : Quantity
    default : Any
        `REQUIRED` where there is none.
    optional : bool
        Whether None is allowed in Python; a file leaves the key out.
    """

    name: str
    kind: Kind
    quantity: Quantity
    default: Any = REQUIRED
    optional: bool = False

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is REQUIRED

    @property
    def allowed(self) -> str:
        """What is allowed, as a sentence without "must be"."""
        return self.quantity.allowed or self.kind.allowed(self.quantity)

    def is_sound_float(self, value: float) -> bool:
        """Whether a number is valid for this field without conversion."""
        return type(self.kind) is Number and math.isfinite(value) and self.quantity.holds(value)

    def take(self, value: Any, key: str, note: Note, from_file: bool = False) -> Any:
        """The value in its normal form; every mistake is noted."""
        if value is None and self.optional and not from_file:
            return None
        return self.kind.take(value, key, self.quantity, note, from_file)

    def json_schema(self) -> dict[str, Any]:
        """JSON schema of the field, with its description, unit and default."""
        unit = f" [{self.quantity.unit}]" if self.quantity.unit else ""
        schema = {"description": self.quantity.description + unit, **self.kind.json_schema(self.quantity)}
        if not self.required and self.default is not None:
            plain = list(self.default) if isinstance(self.default, tuple) else self.default
            if isinstance(plain, str | int | float | list):
                schema["default"] = plain
        return schema


def _json_bounds(q: Quantity) -> dict[str, Any]:
    names = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
    return {name: getattr(q, b) for b, name in names.items() if getattr(q, b) is not None}


def _kind_of(hint: Any) -> tuple[Kind, bool]:
    """Kind of a type hint, and whether None is allowed."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        rest = [a for a in arguments if a is not type(None)]
        optional = len(rest) < len(arguments)
        choices = [a for a in rest if typing.get_origin(a) is Literal]
        others = [a for a in rest if typing.get_origin(a) is not Literal]
        if not choices and len(others) == 1:
            return _kind_of(others[0])[0], optional
        if len(choices) == 1 and others:
            return OneOf(Choice(typing.get_args(choices[0])), tuple(_kind_of(a)[0] for a in others)), optional
    elif hint is float:
        return Number(), False
    elif hint is int:
        return Whole(), False
    elif hint is str:
        return Text(), False
    elif origin is Literal:
        return Choice(arguments), False
    elif origin is tuple and len(arguments) == 2 and arguments[1] is Ellipsis:
        return Items(_kind_of(arguments[0])[0]), False
    elif origin is tuple and len(set(arguments)) == 1:
        return Items(_kind_of(arguments[0])[0], len(arguments)), False
    elif origin is Mapping:
        return ByName(_kind_of(arguments[1])[0]), False
    elif isinstance(hint, type):
        return Table(hint), False
    raise TypeError(f"no kind of field for the type {hint!r}")


def field_from(name: str, hint: Any, default: Any = REQUIRED) -> Field:
    """A field from an annotation such as ``Annotated[float, Quantity(...)]``."""
    quantity = next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Quantity)), None)
    if typing.get_origin(hint) is Annotated:
        hint = hint.__origin__
    if quantity is not None and quantity.variants is not None:
        return Field(name, Variant(), quantity, default, type(None) in typing.get_args(hint))
    kind, optional = _kind_of(hint)
    return Field(name, kind, quantity or Quantity(name), default, optional)


#: Fields of the classes inspected so far: all of them, and those that are keys of a file.
_KNOWN: dict[type, tuple[dict[str, Field], dict[str, Field]]] = {}


def _known(cls: type) -> tuple[dict[str, Field], dict[str, Field]]:
    if cls not in _KNOWN:
        every = _find_fields(cls)
        _KNOWN[cls] = every, {name: f for name, f in every.items() if f.quantity.in_file}
    return _KNOWN[cls]


def all_fields_of(cls: type) -> dict[str, Field]:
    """Every field of a dataclass, by name."""
    return _known(cls)[0]


def fields_of(cls: type) -> dict[str, Field]:
    """The fields of a dataclass that are keys of a file, by name."""
    return _known(cls)[1]


def _find_fields(cls: type) -> dict[str, Field]:
    hints = typing.get_type_hints(cls, include_extras=True)
    found = {}
    for f in dataclasses.fields(cls):
        default = REQUIRED if f.default is dataclasses.MISSING else f.default
        if f.default_factory is not dataclasses.MISSING:
            default = f.default_factory()
        found[f.name] = field_from(f.name, hints[f.name], default)
    return found


def check_fields(instance: Any) -> None:
    """Check all fields of a frozen dataclass, and put them in normal form: floats, tuples.

    Raises
    ------
    TypeError
        A value is of another type; every other mistake is named, too.
    ValueError
        A value is out of its bounds or not finite; all of them are named.
    """
    mistakes: list[Mistake] = []
    for name, f in all_fields_of(type(instance)).items():
        value = getattr(instance, name)
        if value is f.default or (type(value) is float and f.is_sound_float(value)):
            continue
        taken = f.take(value, name, mistakes.append)
        if taken is not value:
            object.__setattr__(instance, name, taken)
    if mistakes:
        kind = type(instance).__name__
        text = "\n".join(f"{kind}.{m.key} = {shown(m.value)}: {m.allowed}" for m in mistakes)
        raise (TypeError if any(m.wrong_type for m in mistakes) else ValueError)(text)


def take_table(
    fields: Mapping[str, Field], data: Any, key: str, note: Note, extra: Sequence[str] = ()
) -> tuple[dict[str, Any], set[str]]:
    """The valid values of a table of a file, defaults filled in, and the names of the invalid fields.

    Parameters
    ----------
    fields
        Keys of the table.
    data
        Contents of the table.
    key
        Dotted key of the table; empty at the top of a file.
    note
        Takes each mistake.
    extra
        Keys that are read elsewhere.
    """
    if not isinstance(data, dict):
        note(Mistake(key, data, "must be a table with " + ", ".join(fields), True))
        return {}, set(fields)
    values: dict[str, Any] = {}
    bad: set[str] = set()
    for name, f in fields.items():
        where = join(key, name)
        if name not in data:
            if f.required:
                note(Mistake(where, REQUIRED, f"missing; must be {f.allowed}", True))
                bad.add(name)
            else:
                values[name] = f.default
            continue
        found: list[Mistake] = []
        taken = f.take(data[name], where, found.append, from_file=True)
        for mistake in found:
            note(mistake)
        if found:
            bad.add(name)
        else:
            values[name] = taken
    for name in data:
        if name not in fields and name not in extra:
            allowed = [*fields, *extra]
            sentence = f"unknown key{meant(name, allowed)}; allowed here: {', '.join(allowed)}"
            note(Mistake(join(key, name), data[name], sentence))
    return values, bad


def table_schema(fields: Mapping[str, Field]) -> dict[str, Any]:
    """JSON schema of a table with these keys and no others."""
    schema: dict[str, Any] = {
        "type": "object",
        "properties": {name: f.json_schema() for name, f in fields.items()},
        "additionalProperties": False,
    }
    required = [name for name, f in fields.items() if f.required]
    return {**schema, **({"required": required} if required else {})}
