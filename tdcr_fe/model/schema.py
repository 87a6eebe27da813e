"""Machinery: how dataclass fields are annotated with bounds, units and descriptions, and how pydantic checks them.

The keys that a file may have are in `tdcr_fe.io.keys`, which takes them from the dataclasses of `tdcr_fe.model`.
A field such as ``length: Annotated[float, Quantity(unit="m", gt=0.0)]`` is checked by `Checked` when the object is
made, and by `Keys.read` when a file is read. Its description is the first sentence about it in the section Attributes
of the class. The JSON schema made of both says what is allowed: in errors, in the templates of files, and to editors.
pydantic is imported when it is needed.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from numbers import Integral, Real
from typing import Annotated, Any, NamedTuple

import numpy as np

from tdcr_fe.model.messages import allowed, join, meant, options, quoted, shown
from tdcr_fe.model.units import PATTERN, has_unit, number_or_none, with_units

#: Stands for the default, or the value, of a key that has none.
REQUIRED: Any = object()

_NAME = "a name in quotes: not empty, printable, no blanks at its ends"


class Mistake(NamedTuple):
    """One value that is not allowed."""

    key: str  # dotted, as in the files
    value: Any  # what was given; REQUIRED where nothing was
    allowed: str  # what is allowed instead
    wrong_type: bool = False  # whether a value of another type is needed


#: Takes key, value and what is allowed of each mistake, as texts.
Note = Callable[[str, str, str], object]


class FieldError(ValueError):
    """A value of a field does not fit the rest of the description.

    Attributes
    ----------
    field, value, allowed : str
    """

    def __init__(self, field: str, value: str, allowed: str) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        super().__init__(f"{field} = {value}: {allowed}" if value else f"{field}: {allowed}")


@dataclass(frozen=True)
class Quantity:
    """Unit, bounds and description of a field; the metadata of ``Annotated``.

    Attributes
    ----------
    description : str
        What it is, for documentation and editors; empty: as in the docstring of the class.
    unit : str
        Unit of every number in it; empty where there is none. Files may give a text with another unit, such as "250
        mm".
    gt, ge, le : float or None
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

    description: str = ""
    unit: str = ""
    gt: float | None = None
    ge: float | None = None
    le: float | None = None
    allowed: str = ""
    note: str = ""
    name: bool = False
    min_items: int = 0
    in_file: bool = True
    infinite: bool = False
    variants: Mapping[str, type] | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Schema by which pydantic checks a value."""
        from pydantic_core import core_schema

        if self.variants is not None:
            return core_schema.nullable_schema(_one_of(self.variants, handler))
        schema = handler(source)
        if self.min_items:
            schema["min_length"] = self.min_items
        self._tighten(schema)
        if self.name:
            return core_schema.no_info_after_validator_function(_checked_name, schema)
        return schema

    def _tighten(self, schema: dict[str, Any]) -> None:
        """Bounds and units for all numbers in a schema; texts without a unit and truth values are no numbers."""
        if schema["type"] == "bool":
            schema["strict"] = True
        if schema["type"] in ("float", "int"):
            bounds = {b: getattr(self, b) for b in ("gt", "ge", "le")}
            schema |= {"strict": True, **{b: x for b, x in bounds.items() if x is not None}}
        if schema["type"] == "float":
            schema["allow_inf_nan"] = self.infinite
            if has_unit(self.unit):
                return self._with_unit(schema)
        parts = [schema.get(k) for k in ("schema", "items_schema", "values_schema", "choices")]
        for part in parts:
            for inner in part if isinstance(part, list) else [part]:
                if isinstance(inner, dict):
                    self._tighten(inner)

    def _with_unit(self, schema: dict[str, Any]) -> None:
        """Let a number also be a text with its unit."""
        from pydantic_core import core_schema

        described = {"pydantic_js_updates": {"type": ["number", "string"], "pattern": PATTERN}}
        number = {**schema, "metadata": described}
        schema.clear()
        schema.update(core_schema.no_info_before_validator_function(self._number_of, number))

    def _number_of(self, value: Any) -> Any:
        """A text with a unit as a number; any other value as it is."""
        number = number_or_none(value, self.unit) if isinstance(value, str) else value
        return value if number is None else number

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """JSON schema with description, unit and what else is said in errors."""
        from pydantic.errors import PydanticInvalidForJsonSchema

        try:
            found = dict(handler(schema))
        except PydanticInvalidForJsonSchema:  # an object of a class that no file names
            found = {}
        unit = f" [{self.unit}]" if self.unit else ""
        texts = {"unit": self.unit, "note": self.note, "allowed": self.allowed or _NAME * self.name}
        found |= {k: v for k, v in texts.items() if v}
        if self.description:
            found["description"] = self.description + unit
        return found | ({"minLength": 1} if self.name else {})


def _checked_name(text: str) -> str:
    if not text.strip() or text != text.strip() or not text.isprintable():
        raise ValueError(f"must be {_NAME}")
    return text


def _one_of(variants: Mapping[str, type], handler: Any) -> Any:
    """Schema of an object of one of the classes, or of a table whose key ``kind`` names the class.

    An object of another class with a ``kind`` is taken, too.
    """
    from pydantic import Discriminator
    from pydantic_core import core_schema

    tagged = handler.generate_schema(Annotated[typing.Union[tuple(variants.values())], Discriminator("kind")])  # noqa: UP007

    def choose(value: Any, tagged: Any) -> Any:
        is_law = not isinstance(value, Mapping) and isinstance(getattr(value, "kind", None), str)
        return value if is_law else tagged(value)

    return core_schema.no_info_wrap_validator_function(choose, tagged)


class Keys(dict[str, Any]):
    """Keys of a table in a file: annotations such as ``Annotated[float, Quantity("mass", "kg", ge=0.0)]`` by name.

    Attributes
    ----------
    defaults : mapping
        Defaults of keys that may be left out.
    """

    def __init__(self, annotations: Mapping[str, Any], defaults: Mapping[str, Any] | None = None) -> None:
        super().__init__(annotations)
        self.defaults = defaults or {}

    @cached_property
    def in_file(self) -> Keys:
        """The keys that files have."""
        found = {n: a for n, a in self.items() if any(getattr(m, "in_file", False) for m in a.__metadata__)}
        return Keys(found, {n: x for n, x in self.defaults.items() if n in found})

    @cached_property
    def _adapter(self) -> Any:
        from pydantic import ConfigDict, TypeAdapter
        from typing_extensions import TypedDict

        make: Any = TypedDict  # of keys that are known only now
        table = make("table", dict(self), total=False)
        table.__pydantic_config__ = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
        return TypeAdapter(table)

    @cached_property
    def json_schema(self) -> dict[str, Any]:
        """JSON schema (draft 2020-12) of a table with these keys and no others."""
        schema = _plain_schema(self._adapter)
        for name, default in self.defaults.items():
            default = list(default) if isinstance(default, tuple) else default
            if isinstance(default, str | int | float | list):
                schema["properties"][name]["default"] = default
        required = [name for name in self if name not in self.defaults]
        return schema | ({"required": required} if required else {})

    def validated(self, data: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
        """The valid values of those that are given, in their normal form, and the errors of pydantic."""
        from pydantic import ValidationError

        check = self._adapter.validator.validate_python
        try:
            return check(data), []
        except ValidationError as error:
            errors = error.errors(include_url=False)
            bad = {e["loc"][0] for e in errors}
            return check({name: value for name, value in data.items() if name not in bad}), errors

    def read(self, data: Any, key: str, note: Note) -> tuple[dict[str, Any], set[str]]:
        """The valid values of a table, defaults filled in, and the names of the keys that are missing or invalid.

        Parameters
        ----------
        data
            Contents of the table.
        key
            Dotted key of the table; empty at the top of a file.
        note
            Takes key, value and what is allowed of each mistake.
        """
        if not isinstance(data, dict):
            note(key, shown(data), "must be a table with " + ", ".join(self))
            return {}, set(self)
        values, errors = self.validated(data)
        errors += [{"type": "missing", "loc": (n,)} for n in self if n not in data and n not in self.defaults]
        order = {name: k for k, name in enumerate(self)}  # unknown keys come last
        errors.sort(key=lambda e: order.get(e["loc"][0], len(order)))
        if errors:
            for m in _mistakes(errors, self.json_schema, data, key):
                note(m.key, "" if m.value is REQUIRED else shown(m.value), m.allowed)
        bad = {e["loc"][0] for e in errors} & set(self)
        return {n: values.get(n, self.defaults.get(n)) for n in self if n not in bad}, bad


def _descriptions(cls: type) -> dict[str, str]:
    """First sentences about the attributes of a class in its numpydoc, without their units."""
    text = inspect.getdoc(cls) or ""
    _, _, section = text.partition("Attributes\n----------\n")
    found: dict[str, str] = {}
    for names, about in re.findall(r"^(\w[\w, ]*)(?: : .*)?\n((?:    .*\n?)*)", section + "\n", re.MULTILINE):
        sentence, _, _ = (" ".join(about.split()) + " ").partition(". ")
        found |= dict.fromkeys(names.split(", "), re.sub(r" \[[^][]*\]$", "", sentence.strip()))
    return found


@cache
def all_keys_of(cls: type[Any]) -> Keys:
    """Every field of a dataclass, as keys."""
    hints, described = typing.get_type_hints(cls, include_extras=True), _descriptions(cls)
    annotations, defaults = {}, {}
    for f in dataclasses.fields(cls):
        hint, extra = hints[f.name], []
        if hasattr(hint, "__metadata__"):
            hint, *extra = typing.get_args(hint)
        quantity = next((m for m in extra if isinstance(m, Quantity)), Quantity())
        text = quantity.description or described.get(f.name, "")
        annotations[f.name] = Annotated[hint, dataclasses.replace(quantity, description=text)]
        if f.default is not dataclasses.MISSING:
            defaults[f.name] = f.default
        elif f.default_factory is not dataclasses.MISSING:
            defaults[f.name] = f.default_factory()
    return Keys(annotations, defaults)


def keys_of(cls: type) -> Keys:
    """The fields of a dataclass that are keys of a file."""
    return all_keys_of(cls).in_file


class Checked:
    """A frozen dataclass whose fields are checked when it is made, and put in normal form: floats, tuples.

    Raises
    ------
    TypeError
        A value is of another type; every other mistake is named, too.
    ValueError
        A value is out of its bounds or not finite; all of them are named.
    """

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        """JSON schema of a table whose keys are the fields, with their descriptions."""
        return {"title": cls.__name__, **keys_of(cls).json_schema}

    def __post_init__(self) -> None:
        cls: Any = type(self)
        keys = all_keys_of(cls)
        given = {n: x for n in keys if (x := getattr(self, n)) is not keys.defaults.get(n, REQUIRED)}
        if not given:
            return
        values = _checked(cls.__name__, keys, given)
        for name, value in values.items():
            if value is not getattr(self, name):
                object.__setattr__(self, name, value)


def _checked(title: str, keys: Keys, given: dict[str, Any]) -> dict[str, Any]:
    """Values in normal form; raises a TypeError or a ValueError where some are wrong, with all mistakes."""
    values, errors = keys.validated(given)
    if errors:  # numbers of other libraries are taken, too
        given = {n: _python_value(x) for n, x in given.items()}
        values, errors = keys.validated(given)
    if errors:
        found = list(_mistakes(errors, keys.json_schema, given))
        text = "\n".join(f"{title}.{m.key} = {shown(m.value)}: {m.allowed}" for m in found)
        raise (TypeError if any(m.wrong_type for m in found) else ValueError)(text)
    return values


def check_instance(
    function: str, argument: str, value: Any, types: type | tuple[type, ...], hint: str
) -> None:
    """Refuse a value of another type, by a TypeError that names function, argument and what was given."""
    if not isinstance(value, types):
        is_short = isinstance(value, str) and len(value) < 60
        given = repr(value) if is_short else f"of type {type(value).__name__}"
        raise TypeError(f"{function}: {argument} is {given}; expected {hint}")


def check_arguments(function: str, keys: Keys, given: Mapping[str, Any]) -> None:
    """Check arguments of a public function as fields of a `Checked` are; ``given`` has others, too, as ``locals()``.

    Keys have no units: arguments are used as they are given, and no text is a number.
    """
    _checked(function, keys, {name: given[name] for name in keys})


def _python_value(value: Any) -> Any:
    """A value with arrays as lists, and numbers of any library as those of Python."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_python_value(x) for x in value]
    if isinstance(value, Mapping):
        return {k: _python_value(x) for k, x in value.items()}
    if isinstance(value, Real) and not isinstance(value, bool | int | float):
        return int(value) if isinstance(value, Integral) else float(value)
    return value


# ------------------------------------------------------------------------------------- what is wrong, in words


def _mistakes(
    errors: Sequence[Mapping[str, Any]], schema: Mapping[str, Any], data: Any, key: str | None = None
) -> Iterator[Mistake]:
    """One mistake for each place that errors of pydantic name; the key is that of a table in a file, None in Python."""
    by_place: dict[str, list[Mistake]] = {}
    for error in errors:
        mistake = _mistake(error, schema, data, key)
        by_place.setdefault(mistake.key, []).append(mistake)
    for key, same in by_place.items():  # several where none of several types fits
        if not any(key.startswith(f"{whole}[") for whole in by_place):  # of a list that is wrong as a whole
            yield same[0]._replace(wrong_type=all(m.wrong_type for m in same))


def _place(schema: Any, data: Any, key: str, loc: Sequence[Any]) -> tuple[str, Any, Any]:
    """Key, JSON schema that says what is allowed, and value, where an error is in data that begins at a key.

    Names of the alternatives of a type are no part of the key.
    """
    node, said, value = schema, schema, data
    for part in loc:
        by_kind = {p["properties"]["kind"].get("const"): p for p in node.get("oneOf", ())}
        if part in by_kind:
            node = said = by_kind[part]
            continue
        child = _child(node, part)
        if child is None:
            break
        if "description" in child or "properties" in child:
            said = child
        elif "additionalProperties" in node:  # a value by name
            said = {**{k: said[k] for k in ("unit", "note") if k in said}, **child}
        node, key = child, join(key, part)
        try:
            value = value[part]
        except (TypeError, KeyError, IndexError):
            value = REQUIRED
    return key, said, value


def _mistake(error: Mapping[str, Any], schema: Any, data: Any, key: str | None) -> Mistake:
    kind, loc, context, in_file = error["type"], error["loc"], error.get("ctx", {}), key is not None
    if kind == "missing" and isinstance(loc[-1], int):
        loc = loc[:-1]  # too few items
    elif loc[-1] == "[key]":
        loc = loc[:-2]
    is_unknown = kind in ("extra_forbidden", "unexpected_keyword_argument")
    key, node, value = _place(schema, data, key or "", loc[:-1] if is_unknown else loc)
    if is_unknown:
        known = list(node["properties"])
        text = f"unknown key{meant(loc[-1], known)}; allowed here: {', '.join(known)}"
        return Mistake(join(key, loc[-1]), error["input"], text, not in_file)
    if kind.startswith("union_tag"):
        value = error["input"].get("kind", REQUIRED)
        names = [part["properties"]["kind"]["const"] for part in node["oneOf"]]
        hint = meant(value, names) if isinstance(value, str) else ""
        text = f"must be one of {', '.join(map(quoted, names))}{hint}"
        return Mistake(join(key, "kind"), value, "missing; " * (value is REQUIRED) + text, True)
    if kind == "missing" and value is REQUIRED:
        return Mistake(key, REQUIRED, f"missing; must be {allowed(node)}", True)
    if isinstance(error := context.get("error"), FieldError) and isinstance(value, Mapping):
        return Mistake(join(key, error.field), value.get(error.field, REQUIRED), error.allowed)
    if kind == "value_error":
        return Mistake(key, value, str(context["error"]))
    wrong_type = kind.endswith("_type") or kind == "is_instance_of"
    if kind == "literal_error":
        wrong_type = not isinstance(value, str)
    cls = context.get("class_name", context.get("class"))
    if cls and not in_file:
        return Mistake(key, value, f"must be of type {cls}", True)
    if not in_file and "title" in node.get("items", {}):
        return Mistake(key, value, f"must be a sequence of {node['items']['title']}", wrong_type)
    text = f"must be {allowed(node)}"
    if isinstance(value, str):
        text = with_units(text, value, node.get("unit", "")) + meant(value, options(node))
    return Mistake(key, value, text, wrong_type)


def _child(node: Mapping[str, Any], part: str | int) -> Any:
    if isinstance(part, int):
        items = node.get("prefixItems", ())
        return items[part] if part < len(items) else node.get("items")
    rest = node.get("additionalProperties")
    return node.get("properties", {}).get(part, rest if isinstance(rest, dict) else None)


def _plain_schema(adapter: Any) -> dict[str, Any]:
    """JSON schema with its definitions filled in, without titles of fields and nulls, which no file can have."""
    from pydantic.json_schema import GenerateJsonSchema

    class Generator(GenerateJsonSchema):
        def nullable_schema(self, schema: Any) -> dict[str, Any]:
            return self.generate_inner(schema["schema"])

        def field_title_should_be_set(self, schema: Any) -> bool:
            return False

    def plain(node: Any) -> Any:
        if isinstance(node, list):
            return [plain(x) for x in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            node = {**found["$defs"][node["$ref"].rpartition("/")[2]], **node}
        left_out = ("$defs", "$ref", "discriminator")
        new = {k: plain(v) for k, v in node.items() if v is not None and k not in left_out}
        if "discriminator" in node:
            for part in new["oneOf"]:
                part["required"] = ["kind", *part.get("required", [])]
        return new

    found = adapter.json_schema(schema_generator=Generator)
    return {k: v for k, v in plain(found).items() if k != "title"}
