"""The private folders of running arenas: where the supervisor makes them and where tools find them."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

RUNTIME_DIR_VARIABLE = "ARENA_RUNTIME_DIR"
"""Environment variable. When it is set, runtime folders are made and searched there only, as tests need it."""


def pointers() -> list[Path]:
    """Return the `run` file of every runtime folder of this user. Folders that others may have written are ignored."""
    bases = [base for base in runtime_bases() if _is_ours(base)]
    return [pointer for base in bases for pointer in sorted(base.glob("*/run")) if _is_ours(pointer.parent)]


def _is_ours(folder: Path) -> bool:
    """Return whether a path is a folder of this user that not everybody may write to."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & stat.S_IWOTH


def runtime_bases() -> list[Path]:
    """Return the folders that may hold runtime folders; new runs use the first.

    All are searched, because a login without XDG_RUNTIME_DIR must find the runs of one that has it.
    """
    if only := os.environ.get(RUNTIME_DIR_VARIABLE):
        return [Path(only)]
    uid, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    given = [Path(xdg) / "arena"] if xdg and Path(xdg).is_dir() else []
    return list(
        dict.fromkeys([*given, Path(tempfile.gettempdir()) / f"arena-{uid}", Path(f"/run/user/{uid}/arena")])
    )
