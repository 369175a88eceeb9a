"""The data that ships with arena: `profiles/` and `templates/`, in a checkout or in an installed package."""

from __future__ import annotations

from pathlib import Path

from arena.errors import InputError, Problem
from arena.schema.loader import load_yaml
from arena.schema.profile import Profile
from arena.schema.source import Source, near
from arena.schema.validate import validate


def data_folder(name: str) -> Path:
    """Return the folder of `profiles` or `templates`: in an installed package inside it, in a checkout beside it."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_data" / name
    return installed if installed.is_dir() else package.parent / name


def profile_names() -> list[str]:
    return sorted(path.stem for path in data_folder("profiles").glob("*.yaml"))


def load_profile(name: str) -> Profile:
    """Return a profile that ships with arena. Raises InputError when there is none, or its file is wrong."""
    if name not in profile_names():
        raise InputError(f"got {name!r}, expected a profile. {near(name, profile_names())}")
    return read_profile(data_folder("profiles") / f"{name}.yaml")


def read_profile(path: Path) -> Profile:
    """Return the profile in a file. Raises InputError with every problem found."""
    document = load_yaml(path)
    found = validate(Profile, Source(document=document, data=document.data))
    problems = list(found.problems)
    if found.model is not None:
        problems += [Problem(file=str(path), line=1, field="", message=p) for p in found.model.problems()]
    if problems or found.model is None:
        raise InputError(problems)
    return found.model
