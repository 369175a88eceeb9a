"""Validation of a YAML document by a pydantic model. Each problem becomes one line of plain text.

A wrong value is reported and removed. Then the document is validated again, so that one wrong type does not hide further
problems. Cross-checks skip the removed values, which are in `Validated.pruned`.
"""

from __future__ import annotations

import contextlib
import copy
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Generic, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from arena.errors import Problem
from arena.schema.base import Strict
from arena.schema.loader import YamlPath, dotted
from arena.schema.models import LIST_ITEMS, OTHER_NAMES, PLANNED_KEYS, PLANNED_VALUES
from arena.schema.source import Source, as_list, near, show

_MOST_ROUNDS = 20
_NO_PLUGINS = "PYDANTIC_DISABLE_PLUGINS"
_PLUGIN_LOADER = "pydantic.plugin._loader"

M = TypeVar("M", bound=Strict)


@dataclass(frozen=True, kw_only=True)
class Validated(Generic[M]):
    """Result of a validation: the pydantic model, and the problems found.

    model: the model, or None if too many values are wrong.
    pruned: paths of wrong values, which were removed.
    """

    model: M | None
    problems: tuple[Problem, ...]
    pruned: frozenset[YamlPath]


def validate(kind: type[M], source: Source) -> Validated[M]:
    data, problems, pruned = copy.deepcopy(source.data), [], set[YamlPath]()
    model: M | None = None
    for _ in range(_MOST_ROUNDS):
        try:
            with _without_plugins():
                model = kind.model_validate(data)
            break
        except ValidationError as error:
            details = error.errors(include_url=False)
        for detail in details:
            path = tuple(part for part in detail["loc"] if part != "[key]")
            if detail["type"] in ("missing", "too_short") and any(p[: len(path)] == path for p in pruned):
                pruned.add(
                    _prune(data, path, missing=detail["type"] == "missing")
                )  # missing because it was removed as wrong; already reported
                continue
            item = detail["type"] == "missing" and path and isinstance(path[-1], int)
            problems.append(source.problem(path[:-1] if item else path, _sentence(kind, path, detail)))
            pruned.add(_prune(data, path, missing=detail["type"] == "missing"))
        if () in pruned:
            break
    return Validated(model=model, problems=tuple(dict.fromkeys(problems)), pruned=frozenset(pruned))


@contextlib.contextmanager
def _without_plugins() -> Iterator[None]:
    """Disable pydantic's plugins inside a `with` block. The search for plugins reads all packages and is slow.

    The module that searches them imports `importlib.metadata` even if they are disabled. An empty module replaces it.
    """
    before = os.environ.get(_NO_PLUGINS)
    os.environ[_NO_PLUGINS] = "1"
    replaced = _PLUGIN_LOADER not in sys.modules
    if replaced:
        sys.modules[_PLUGIN_LOADER] = _no_plugins()
    try:
        yield
    finally:
        if replaced:
            del sys.modules[_PLUGIN_LOADER]
        if before is None:
            del os.environ[_NO_PLUGINS]
        else:
            os.environ[_NO_PLUGINS] = before


def _no_plugins() -> ModuleType:
    """Return a module with the function of pydantic's plugin loader that lists the plugins. It lists none."""
    module = ModuleType(_PLUGIN_LOADER)
    module.__dict__["get_plugins"] = tuple
    return module


def _prune(data: Any, path: YamlPath, *, missing: bool) -> YamlPath:
    """Remove a wrong value from the YAML document, so that validation can continue. Return its path.

    An item of a list is not removed alone: the mapping key that contains the list is removed.
    """
    end = len(path) - (1 if missing else 0)
    while end and not isinstance(path[end - 1], str):
        end -= 1
    here = data
    for part in path[: max(end - 1, 0)]:
        here = here[part] if isinstance(here, dict) and part in here else None
    if end == 0 or not isinstance(here, dict):
        return () if end == 0 else path[:end]
    here.pop(path[end - 1], None)
    return path[:end]


def _sentence(kind: type[BaseModel], path: YamlPath, detail: ErrorDetails) -> str:
    type_, got = detail["type"], detail["input"]
    if type_ == "extra_forbidden" and path[-1] in PLANNED_KEYS:
        return f"{path[-1]} is not available yet. {PLANNED_KEYS[str(path[-1])]}."
    if type_ == "extra_forbidden" and path[-1] in OTHER_NAMES:
        return f"unknown key. {OTHER_NAMES[str(path[-1])]}."
    if isinstance(got, str) and path and (path[-1], got) in PLANNED_VALUES:
        return f"{got} is not available yet. {PLANNED_VALUES[str(path[-1]), got]}."
    if type_ == "extra_forbidden":
        return f"unknown key. {_instead(kind, path)}"
    if expected := _list_expected(path, type_):
        return f"got {show(got)}, expected {expected}."
    if type_ == "missing":
        return "is missing" + (". Give at least one vehicle" if path == ("vehicles",) else "")
    expected = _expected(kind, path, detail)
    hint = f" {near(got, _choices(detail))}" if type_ == "literal_error" and isinstance(got, str) else ""
    if type_ == "tuple_type" and isinstance(got, str):
        hint = f" Did you mean {as_list(got.split())}?"
    if type_ == "string_type" and isinstance(got, (int, float)):
        hint = f" Did you mean '{show(got)}', in quotes?"
    if type_ == "value_error" and isinstance(got, dict) and set(got) <= set(keys_at(kind, path)):
        return f"expected {expected}."  # the mapping's keys are right, the values contradict each other
    return f"got {show(got)}, expected {expected}." + (hint if hint.startswith(" Did") else "")


def _list_expected(path: YamlPath, type_: str) -> str:
    """Return which list a key expects, such as `a list of 3 numbers: north, east, height [m]`; "" if it is not wrong as a list.

    path: that of the key, or of a missing item. type_: pydantic's type of the error.
    """
    too_short = type_ == "missing" and bool(path) and isinstance(path[-1], int)
    key = path[:-1] if too_short else path
    items = LIST_ITEMS.get((str(key[-2]), str(key[-1]))) if len(key) > 1 else None
    if too_short or type_ == "too_long" or (type_ == "tuple_type" and items):
        return f"a list of 3 numbers: {items}" if items else "a list of 3"
    return ""


def _instead(kind: type[BaseModel], path: YamlPath) -> str:
    """Return a hint for an unknown key, such as a similar key.

    The hint names the section that has this key, if there is exactly one, else the most similar key. Sections below that of the
    wrong key come first: `restart` of a vehicle is a key of its program. The sections of a tool are those of special tools.
    """
    below = [keys for keys in _below(_kind_at(kind, path[:-1])) if keys[-1] == path[-1]]
    if len(below) == 1 and path[0] != "tools":
        return f"Did you mean {dotted((*path[:-1], *below[0]))}?"
    elsewhere = [keys for keys in _below(kind) if len(keys) > len(path) and keys[-len(path) :] == path]
    if len(elsewhere) == 1:
        return f"Did you mean {dotted(elsewhere[0])}?"
    return near(str(path[-1]), keys_at(kind, path[:-1]))


def _below(kind: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of every key of a model and of its nested models.

    Keys below `vehicles` and `tools` are skipped, because users choose the names there.
    """
    model = _model_of(kind)
    for key, field in model.model_fields.items() if model is not None else ():
        yield (*path, key)
        yield from _below(field.annotation, (*path, key))


def _choices(detail: ErrorDetails) -> list[str]:
    return [
        part.strip("'")
        for part in str(detail.get("ctx", {}).get("expected", "")).replace(" or ", ", ").split(", ")
    ]


_EXPECTED = {
    "string_type": "text",
    "int_type": "an integer",
    "int_from_float": "an integer",
    "float_type": "a number",
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "dict_type": "a mapping of names",
    "tuple_type": "a list",
    "int_parsing_size": "a smaller number",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "string_pattern_mismatch": "only letters, digits, _ . and -, starting with a letter or digit",
}


def _expected(kind: type[BaseModel], path: YamlPath, detail: ErrorDetails) -> str:
    context: dict[str, Any] = detail.get("ctx", {})
    type_ = detail["type"]
    if type_ == "literal_error":
        return ", ".join(_choices(detail)[:-1]) + f" or {_choices(detail)[-1]}"
    if type_ == "value_error":
        return str(context["error"]).removeprefix("expected ")
    if type_ in ("model_type", "model_attributes_type"):
        return f"a mapping with keys such as {', '.join(keys_at(kind, path)[:4])}"
    if type_ in ("too_short",):
        return f"at least {context['min_length']} entry"
    return _EXPECTED[type_].format(**context) if type_ in _EXPECTED else detail["msg"]


def keys_at(kind: Any, path: YamlPath) -> list[str]:
    """Return the keys that the model allows at a YAML path. `vehicles.uav1` gives the keys of a vehicle."""
    found = _model_of(_kind_at(kind, path))
    return list(found.model_fields) if found is not None else []


def _kind_at(kind: Any, path: YamlPath) -> Any:
    """Return the type of the value that the model allows at a YAML path; None for an unknown path."""
    for part in path:
        model = _model_of(kind)
        field = model.model_fields.get(str(part)) if model is not None else None
        if field is not None:
            kind = field.annotation
        elif _value_type(kind) is not None:
            kind = _value_type(kind)
        else:
            return None
    return kind


def _model_of(kind: Any) -> type[BaseModel] | None:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind
    return (
        next((arg for arg in get_args(kind) if isinstance(arg, type) and issubclass(arg, BaseModel)), None)
        if not _value_type(kind)
        else None
    )


def _value_type(kind: Any) -> Any:
    for option in (kind, *get_args(kind)):
        if getattr(option, "__origin__", None) is dict:
            return get_args(option)[1]
    return None
