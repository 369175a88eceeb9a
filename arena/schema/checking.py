"""Input of the cross-checks of arena.yaml: the arena, the line numbers of its keys, and file access.

A cross-check compares several YAML keys with each other.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from arena.errors import Problem
from arena.schema.arena import Arena, Px4, Vehicle
from arena.schema.loader import YamlPath
from arena.schema.px4 import find_px4
from arena.schema.source import Source


class Files(Protocol):
    """Interface through which the checks of arena.yaml read files. Tests replace the real file system.

    All paths are absolute.
    """

    def is_file(self, path: str) -> bool: ...

    def is_executable(self, path: str) -> bool: ...

    def content(self, path: str) -> bytes: ...

    def names(self, folder: str) -> list[str]: ...

    def find_px4(self, home: str | None) -> Px4 | None: ...


class RealFiles:
    """File system of this computer, as the checks of arena.yaml use it."""

    def is_file(self, path: str) -> bool:
        return Path(path).is_file()

    def is_executable(self, path: str) -> bool:
        return os.access(path, os.X_OK)

    def content(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def names(self, folder: str) -> list[str]:
        try:
            return sorted(path.name for path in Path(folder).iterdir())
        except OSError:
            return []

    def find_px4(self, home: str | None) -> Px4 | None:
        return find_px4(home)


@dataclass(frozen=True, kw_only=True)
class Check:
    """Input of a check of arena.yaml, with methods that find the line of a value and report a problem.

    pruned: paths of values that are already reported as wrong; checks skip them.
    """

    arena: Arena
    source: Source
    pruned: frozenset[YamlPath]
    files: Files

    def where(self, vehicle: str, *key: str) -> YamlPath:
        """Return the YAML path that sets a vehicle's key: `vehicles.NAME.KEY`, or `defaults.KEY` if only that is given."""
        return self.source.layer(vehicle, *key)

    def place_of(self, vehicle: Vehicle, key: str) -> str:
        """Return file and line of a vehicle's key as text, such as `arena.yaml:14`."""
        file, line = self.source.place(self.where(vehicle.name, key))
        return f"{file}:{line}" if line else file

    def problem(self, vehicle: str, key: tuple[str | int, ...], message: str) -> Problem:
        words = tuple(str(k) for k in key)
        return self.source.problem(("vehicles", vehicle, *key), message, at=self.where(vehicle, *words))

    def sound(self, vehicle: Vehicle, *keys: str) -> bool:
        """Return whether the values of these keys of a vehicle are valid so far.

        Checks skip keys for which a problem has already been reported.
        """
        roots = [("vehicles", vehicle.name, key) for key in keys] + [("defaults", key) for key in keys]
        return not any(path[: len(root)] == root for path in self.pruned for root in roots)
