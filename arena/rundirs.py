"""Where the private folders of running arenas are, for the supervisor that makes them and the tools that look for them."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

ONLY = "ARENA_RUNTIME_DIR"
"""When set, runtime folders are here and are looked for nowhere else: arenas kept apart, as tests must be."""


def runtime_bases() -> list[Path]:
    """The first is used for new runs. A login without XDG_RUNTIME_DIR still finds the others."""
    if only := os.environ.get(ONLY):
        return [Path(only)]
    uid, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    given = [Path(xdg) / "arena"] if xdg and Path(xdg).is_dir() else []
    return list(dict.fromkeys([*given, Path(tempfile.gettempdir()) / f"arena-{uid}", Path(f"/run/user/{uid}/arena")]))
