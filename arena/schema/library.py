"""Loads the profiles and templates that are part of arena, and applies a vehicle's mass and sensor noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError, Problem
from arena.schema.loader import Document, load_yaml
from arena.schema.profile import Profile
from arena.schema.source import Source, near
from arena.schema.validate import Validated, validate


def data_folder(name: str) -> Path:
    """Return the path of the folder `profiles` or `templates`.

    It is inside an installed package, or beside the package in a checkout.
    """
    package = Path(__file__).resolve().parent.parent
    installed = package / "_data" / name
    return installed if installed.is_dir() else package.parent / name


def profile_names() -> list[str]:
    return sorted(path.stem for path in data_folder("profiles").glob("*.yaml"))


def load_profile(name: str) -> Profile:
    """Return a profile that is part of arena. Raises InputError if it does not exist or its file is wrong."""
    if name not in profile_names():
        raise InputError(f"got {name!r}, expected the name of a profile. {near(name, profile_names())}")
    return read_profile(data_folder("profiles") / f"{name}.yaml")


def read_profile(path: Path) -> Profile:
    """Read a profile file. Raises InputError with every problem found."""
    document = load_yaml(path)
    found = validate(Profile, Source(document=document, data=document.data))
    problems = list(found.problems)
    if found.model is not None:
        problems += [Problem(file=str(path), line=1, field="", message=p) for p in found.model.problems()]
    if problems or found.model is None:
        raise InputError(problems)
    return found.model


Overrides = Mapping[str, Any]
"""The values in a vehicle's YAML that replace the profile's: `mass_kg`, and `sensors` (sensor -> key -> value)."""


def with_overrides(profile: Profile, overrides: Overrides) -> Profile:
    """Return the profile with a vehicle's own mass and sensor noise instead of the profile's values.

    Wrong values are ignored here; `override_problems` reports them.
    """
    if not overrides:
        return profile
    found = _validated(profile, overrides)
    return profile if found.model is None or found.problems else found.model


def override_problems(profile: Profile, overrides: Overrides) -> Iterator[tuple[tuple[str, ...], str]]:
    """Check the mass and sensor noise that replace a profile's values. Yield (YAML path, message) for each wrong value.

    The path is below the vehicle.
    """
    if not overrides:
        return
    found = _validated(profile, overrides)
    for problem in found.problems:
        yield tuple(problem.field.split(".")), problem.message
    if found.model is not None and not found.problems:
        most = found.model.curve.max_newtons / GRAVITY_M_S2
        if found.model.mass_kg >= most:
            message = f"got {found.model.mass_kg:g}, expected less than {most:.2f}, which is the most that the rotors lift."
            yield ("mass_kg",), message


def _validated(profile: Profile, overrides: Overrides) -> Validated[Profile]:
    data = _merged(profile.as_dict(), overrides)
    return validate(Profile, Source(document=Document(file=profile.name, data=data), data=data))


def _merged(under: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two nested mappings key by key. Values of `over` replace values of `under`."""
    found = dict(under)
    for key, value in over.items():
        inner = found.get(key)
        found[key] = (
            _merged(inner, value) if isinstance(inner, dict) and isinstance(value, Mapping) else value
        )
    return found
