"""Where the private folders of running arenas are, for the supervisor that makes them and the tools that look for them."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

ONLY = "ARENA_RUNTIME_DIR"
"""When set, runtime folders are here and are looked for nowhere else: arenas kept apart, as tests must be."""


def pointers() -> list[Path]:
    """The `run` file of every runtime folder that is this user's own: what others put in its place names no arena of ours."""
    bases = [base for base in runtime_bases() if _is_ours(base)]
    return [pointer for base in bases for pointer in sorted(base.glob("*/run")) if _is_ours(pointer.parent)]


def _is_ours(folder: Path) -> bool:
    """A folder, of this user, that not everybody may write to."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & stat.S_IWOTH


def runtime_bases() -> list[Path]:
    """The first is used for new runs. A login without XDG_RUNTIME_DIR still finds the others."""
    if only := os.environ.get(ONLY):
        return [Path(only)]
    uid, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    given = [Path(xdg) / "arena"] if xdg and Path(xdg).is_dir() else []
    return list(
        dict.fromkeys([*given, Path(tempfile.gettempdir()) / f"arena-{uid}", Path(f"/run/user/{uid}/arena")])
    )
