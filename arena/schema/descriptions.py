"""Reads the descriptions of YAML keys from the source code: the docstring below each field of a model.

pydantic can read them (`use_attribute_docstrings`), but would parse the source at every import, which takes longer than all
checks of an arena. Only the JSON schema and the reference pages need them.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from typing import Any

from pydantic import BaseModel

from arena.schema.base import Strict


def descriptions(model: type[BaseModel]) -> dict[str, str]:
    """Return field name -> description, for every field of a model that has a description."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Strict) and base is not Strict:
            found.update(_own(base))
    return {name: text for name, text in found.items() if name in model.model_fields}


def add_descriptions(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """Add the descriptions of all keys to the JSON schema of a model and to its `$defs`, in place."""
    models = {each.__name__: each for each in _family(Strict)}
    for part, of in ((schema, model), *((part, models[name]) for name, part in schema["$defs"].items())):
        for name, text in descriptions(of).items():
            key = part["properties"][name]
            part["properties"][name] = dict(sorted({**key, "description": text}.items()))


def _own(model: type[BaseModel]) -> dict[str, str]:
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in itertools.pairwise(tree.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _family(model: type[BaseModel]) -> list[type[BaseModel]]:
    return [each for child in model.__subclasses__() for each in (child, *_family(child))]
