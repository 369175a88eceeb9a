"""Entry point of `arena.schema`: `load_arena` turns arena.yaml and `--set` overrides into an Arena.

Raises one InputError with every problem found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from arena.errors import ArenaError, InputError, Problem
from arena.schema.arena import Arena
from arena.schema.checking import Check, Files, RealFiles
from arena.schema.checks import check
from arena.schema.library import load_profile, read_profile
from arena.schema.loader import Document, YamlPath, load_yaml
from arena.schema.models import ArenaFile
from arena.schema.profile import Profile
from arena.schema.resolve import DEFAULT_PROFILE, resolve
from arena.schema.signing import key_problems
from arena.schema.source import Source, with_overrides
from arena.schema.validate import validate


def load_arena(path: str | Path, overrides: Sequence[str] = (), files: Files | None = None) -> Arena:
    """Return the validated arena of a YAML file.

    path: the file, or a folder with an arena.yaml.
    overrides: `key=value` texts of `--set`.
    files: the file system; by default that of this machine.
    Raises InputError with every problem, in the order of the file.
    """
    if Path(path).is_dir():
        path = Path(path) / "arena.yaml"
    if Path(path).suffix == ".py":
        raise InputError(
            f"{path}: is a Python program, not the YAML file of an arena. Write it in a YAML file, such as "
            f"`vehicles: {{uav1: {{program: {Path(path).name}}}}}`, and give that file"
        )
    return arena_of(load_yaml(path), overrides, files)


def arena_of(
    document: Document,
    overrides: Sequence[str] = (),
    files: Files | None = None,
    *,
    cross_checks: bool = True,
) -> Arena:
    """Return the validated arena of an already parsed YAML document, such as the arena in a scenario.

    cross_checks: compare values with each other, such as the start positions of the vehicles. A replay needs no such check.
    """
    source = with_overrides(document, overrides)
    found = validate(ArenaFile, source)
    if found.model is None:
        raise InputError(found.problems)
    profiles, problems = _profiles(found.model, source)
    params, more = _params_files(found.model, source)
    files = files or RealFiles()
    arena = resolve(found.model, source, profiles, files.find_px4, params)
    problems += more
    keys = {v.name: v.key_file for v in arena.hardware if v.key_file}
    problems += [source.problem(path, said) for path, said in key_problems(keys)] if keys else []
    problems += found.problems
    if cross_checks:
        problems += check(Check(arena=arena, source=source, pruned=found.pruned, files=files))
    if problems:
        raise InputError(sorted(problems, key=lambda p: (p.file, p.line)))
    return arena


def _profiles(model: ArenaFile, source: Source) -> tuple[dict[str, Profile], list[Problem]]:
    """Load the vehicle profiles that the YAML names. Return name -> profile, and the problems found."""
    profiles, problems = {DEFAULT_PROFILE: load_profile(DEFAULT_PROFILE)}, []
    asked: dict[YamlPath, str] = {
        ("vehicles", name, "profile"): v.profile for name, v in model.vehicles.items() if v.profile
    }
    if model.defaults.profile:
        asked["defaults", "profile"] = model.defaults.profile
    folder = Path(source.document.file).parent
    for path, name in asked.items():
        if name in profiles:
            continue
        try:
            profiles[name] = read_profile(folder / name) if name.endswith(".yaml") else load_profile(name)
        except InputError as error:
            said = "; ".join(p.message for p in error.problems) or f"{error}"
            problems.append(source.problem(path, said))
    return profiles, problems


def _params_files(model: ArenaFile, source: Source) -> tuple[dict[str, Mapping[str, float]], list[Problem]]:
    """Read every `params_file` of the YAML. Return file name -> parameters, and the problems found."""
    found: dict[str, Mapping[str, float]] = {}
    problems = []
    asked: dict[YamlPath, str] = {
        ("vehicles", name, "params_file"): v.params_file
        for name, v in model.vehicles.items()
        if v.params_file
    }
    if model.defaults.params_file:
        asked["defaults", "params_file"] = model.defaults.params_file
    if not asked:
        return {}, []
    from arena.wire.qgc_params import parse_params

    folder = Path(source.document.file).parent
    for path, name in asked.items():
        try:
            found[name] = parse_params((folder / name).read_text())
        except OSError as error:
            problems.append(source.problem(path, f"got {name!r}, which cannot be read: {error.strerror}."))
        except (ArenaError, ValueError) as error:
            problems.append(source.problem(path, f"{name}: {error}"))
    return found, problems
