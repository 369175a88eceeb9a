"""A vehicle's own mass and sensor noise, laid over its profile. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from arena.constants import GRAVITY_M_S2
from arena.schema.loader import Document
from arena.schema.profile import Profile
from arena.schema.source import Source
from arena.schema.validate import Validated, validate

Overrides = Mapping[str, Any]
"""`mass_kg`, and `sensors`: sensor -> key -> value, as the YAML of a vehicle gives them."""


def with_overrides(profile: Profile, overrides: Overrides) -> Profile:
    """Return the profile with a vehicle's overrides, or unchanged when they are wrong: `problems` has the reasons."""
    found = _validated(profile, overrides)
    return profile if found.model is None or found.problems else found.model


def problems(profile: Profile, overrides: Overrides) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield (path under the vehicle, message) for every override that the profile cannot have."""
    found = _validated(profile, overrides)
    for problem in found.problems:
        yield tuple(problem.field.split(".")), problem.message
    if found.model is not None and not found.problems:
        most = found.model.curve.max_newtons / GRAVITY_M_S2
        if found.model.mass_kg >= most:
            message = f"got {found.model.mass_kg:g}, expected less than {most:.2f}: the rotors lift no more."
            yield ("mass_kg",), message


def _validated(profile: Profile, overrides: Overrides) -> Validated[Profile]:
    data = _merged(profile.model_dump(mode="python"), overrides)
    return validate(Profile, Source(document=Document(file=profile.name, data=data), data=data))


def _merged(under: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return two mappings merged key by key, at every depth."""
    found = dict(under)
    for key, value in over.items():
        inner = found.get(key)
        found[key] = (
            _merged(inner, value) if isinstance(inner, dict) and isinstance(value, Mapping) else value
        )
    return found
