"""Files that determine the flights of a campaign, and their hashes. Results before and after a change cannot be compared."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import arena
from arena.schema import Arena
from arena.schema.library import data_folder

PACKAGE, PX4 = "the installed arena", "PX4"
"""Keys that represent all modules and profiles of the installed arena, and the installed PX4, among the paths of files."""


def files_of(flown: str, arena: Arena) -> set[Path]:
    """Return the files that determine the flights of one point: arena, scenario, programs, profiles, parameter files.

    Modules that a program imports are not included.
    flown: path of the arena or scenario that the sweep file names.
    """
    names = {flown, arena.file}
    names |= {v.program.path for v in arena.vehicles if v.program}
    names |= {v.profile_key for v in arena.vehicles if v.profile_key.endswith(".yaml")}
    for v in arena.vehicles:
        if given := arena.source.value(arena.source.layer(v.name, "params_file")):
            names.add(str(Path(arena.folder, given)))
    paths = (Path(name, "arena.yaml") if Path(name).is_dir() else Path(name) for name in names)
    return {path for path in paths if path.is_file()}


def digests(files: Iterable[Path], folder: Path, px4: str = "") -> dict[str, str]:
    """Return path relative to `folder` -> SHA-256 of each file, and the SHA-256 of the installed arena and of PX4.

    px4: path of PX4's binary; "" without PX4.
    """
    found = {os.path.relpath(path, folder): digest_of(str(path)) for path in sorted(files)}
    return {**found, PACKAGE: digest_of(PACKAGE), **({PX4: digest_of(px4)} if px4 else {})}


def px4_binary(arena: Arena) -> str:
    """Return the path of the PX4 binary that an arena flies; "" if it flies none, or the stand-in for PX4."""
    return arena.px4.argv[0] if arena.px4 is not None and not arena.px4.stand_in else ""


def digest_of(path: str) -> str:
    """Return the SHA-256 of a file; "" if the file cannot be read.

    path: path of the file. The key PACKAGE gives one SHA-256 of all modules and profiles of the installed arena.
    """
    if path == PACKAGE:
        return _package_digest()
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


def changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return the files that were changed since the first flights of a campaign.

    A file that only one side has belongs to values of settings that were added or removed, except the installed arena.
    before, now: path -> SHA-256
    """
    both = (before.keys() & now.keys()) | {PACKAGE}
    return sorted(path for path in both if before.get(path, "") != now.get(path, ""))


class FileWatch:
    """Finds files that are changed while a campaign flies.

    inputs: path relative to `folder` -> SHA-256 of each file, as `digests` returns it.
    """

    def __init__(self, inputs: Mapping[str, str], folder: Path) -> None:
        self._files = {
            name: (folder / name, digest) for name, digest in inputs.items() if name not in (PACKAGE, PX4)
        }
        self._seen: dict[str, tuple[int, int]] = {}

    def changed(self) -> list[str]:
        """Return the files whose content differs from that at the start. A file is read again only after it was written."""
        found = []
        for name, (path, digest) in self._files.items():
            try:
                status = path.stat()
            except OSError:
                found.append(name)
                continue
            stamp = status.st_mtime_ns, status.st_size
            if stamp == self._seen.get(name):
                continue
            if digest_of(str(path)) == digest:
                self._seen[name] = stamp
            else:
                found.append(name)
        return found


@cache
def _package_digest() -> str:
    folder, profiles = Path(arena.__file__).parent, data_folder("profiles")
    made = hashlib.sha256()
    for root, pattern in ((folder, "*.py"), (profiles, "*.yaml")):
        for path in sorted(root.rglob(pattern)):
            made.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return made.hexdigest()
