"""Location of the runtime folders: private folders for the sockets of running arenas. Other commands find runs through them."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

RUNTIME_DIR_VARIABLE = "ARENA_RUNTIME_DIR"
"""Environment variable for tests: the only folder in which runtime folders are created and searched."""


def pointers() -> list[Path]:
    """Return the path of the `run` file in every runtime folder of this user. This file contains the path of a run folder.

    Folders that other users own or may write to are ignored.
    """
    bases = [base for base in runtime_bases() if _is_ours(base)]
    return [pointer for base in bases for pointer in sorted(base.glob("*/run")) if _is_ours(pointer.parent)]


def _is_ours(folder: Path) -> bool:
    """Return whether a path is a folder that this user owns and that is not writable for all users."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & stat.S_IWOTH


def runtime_bases() -> list[Path]:
    """Return the folders that may contain runtime folders. New runs use the first one.

    All are searched, because a terminal without XDG_RUNTIME_DIR must find the runs of a terminal in which it is set.
    """
    if only := os.environ.get(RUNTIME_DIR_VARIABLE):
        return [Path(only)]
    uid, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    given = [Path(xdg) / "arena"] if xdg and Path(xdg).is_dir() else []
    return list(
        dict.fromkeys([*given, Path(tempfile.gettempdir()) / f"arena-{uid}", Path(f"/run/user/{uid}/arena")])
    )
