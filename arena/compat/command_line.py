"""Converts the command line with which `arena up` starts a program to the arguments that old programs read.

Old programs were written for the ISR Flying Arena thesis. They read `ns mass radius height num_rotors thrust_curve`, then
their own arguments.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from arena.errors import InputError

OPTION = "--uav"
_settings_file: list[str] = []


def translate() -> None:
    """Replace the arguments of `arena up` in `sys.argv` by those that programs of the thesis read.

    `arena up` passes `--uav FILE` and the arguments of the YAML. The program reads `sys.argv[1]` to `sys.argv[6]` (name, mass [kg],
    radius [m], height [m], number of rotors, name of the thrust curve), and its own arguments after them. A command line without
    `--uav` stays as it is. Raises InputError if FILE cannot be read.
    """
    if sys.argv[1:2] == [OPTION] and len(sys.argv) > 2:
        _settings_file[:] = [sys.argv[2]]
        sys.argv[1:3] = _launcher_arguments(sys.argv[2])


def uav_options(name: str) -> list[str]:
    """Return the command-line arguments to pass to `arena.UAV.from_args`.

    name: of the vehicle, for a program that was started by hand.
    """
    return [OPTION, *_settings_file] if _settings_file else ["--ns", name]


def vehicle_name() -> str | None:
    """Return the vehicle for which `arena up` has started this program; None if it was started by hand."""
    return _settings()["vehicle"] if _settings_file else None


def clock_path() -> str | None:
    """Return the path of the simulation clock's files, without suffix; None if the program uses the wall clock."""
    return _settings().get("clock") if _settings_file else None


def _settings(file: str = "") -> dict[str, Any]:
    file = file or _settings_file[0]
    try:
        found: dict[str, Any] = json.loads(Path(file).read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{OPTION} {file}: {error}") from error
    return found


def _launcher_arguments(file: str) -> list[str]:
    settings = _settings(file)
    profile = settings["profile"]
    numbers = [profile[key] for key in ("mass_kg", "radius_m", "height_m", "num_rotors")]
    return [settings["vehicle"], *map(str, numbers), str(profile["name"])]
