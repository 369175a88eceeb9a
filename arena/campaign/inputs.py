"""Files that determine the flights of a campaign, and their hashes. Results before and after a change cannot be compared."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from pathlib import Path

import arena
from arena.schema import Arena
from arena.schema.library import data_folder
from arena.schema.px4 import STAND_IN

PACKAGE, PX4 = "the installed arena", "PX4"
"""Keys of the dict `path -> SHA-256` that are not paths. PACKAGE: all files of the installed arena. PX4: all PX4 binaries that fly."""
_CODE = {".py", ".pyx", ".pxd", ".csv"}


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


def digests(files: Iterable[Path], folder: Path, px4s: Collection[str] = ()) -> dict[str, str]:
    """Return path relative to `folder` -> SHA-256 of each file, and the SHA-256 of the installed arena and of PX4.

    px4s: for each PX4 that flies, as `px4_of` returns it.
    """
    found = {os.path.relpath(path, folder): digest_of(str(path)) for path in sorted(files)}
    each = sorted(name if name == STAND_IN else digest_of(name) for name in px4s)
    flown = {PX4: hashlib.sha256(" ".join(each).encode()).hexdigest()} if each else {}
    return {**found, PACKAGE: digest_of(PACKAGE), **flown}


def px4_of(arena: Arena) -> set[str]:
    """Return the path of the PX4 binary that an arena flies, STAND_IN for the stand-in for PX4, or nothing without PX4."""
    if arena.px4 is None or not any(v.autopilot == "px4" for v in arena.vehicles):
        return set()
    return {STAND_IN if arena.px4.stand_in else arena.px4.argv[0]}


def digest_of(path: str) -> str:
    """Return the SHA-256 of a file; "" if the file cannot be read.

    path: path of the file. The key PACKAGE gives one SHA-256 of all files of the installed arena.
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
    """Check for files that were changed after the start of a campaign. Call `changed` regularly.

    inputs: path relative to `folder` -> SHA-256 of each file, as `digests` returns it.
    """

    def __init__(self, inputs: Mapping[str, str], folder: Path) -> None:
        self._files = {
            name: (folder / name, digest) for name, digest in inputs.items() if name not in (PACKAGE, PX4)
        }
        self._seen: dict[str, tuple[int, int]] = {}

    def changed(self) -> list[str]:
        """Return the files whose content is no longer that of the start. A file is read only if it was written since the last call."""
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
    made = hashlib.sha256()
    package = Path(arena.__file__).parent
    paths = [(package, path) for path in package.rglob("*") if path.suffix in _CODE]
    for name in ("profiles", "templates"):
        folder = data_folder(name)
        paths += [(folder, path) for path in folder.rglob("*") if path.is_file()]
    for root, path in sorted(paths):
        made.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return made.hexdigest()
