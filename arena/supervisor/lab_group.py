"""Shares the runtime folder of a run with a user group, so that its members can land the vehicles.

The environment variable ARENA_GROUP names the group.
"""

from __future__ import annotations

import grp
import os
from pathlib import Path

from arena.errors import RunError
from arena.run_dirs import GROUP_VARIABLE


def group_id() -> int | None:
    """Return the id of the user group in ARENA_GROUP, or None if the variable is not set.

    Raises RunError if there is no such group, or this user does not belong to it.
    """
    name = os.environ.get(GROUP_VARIABLE, "")
    if not name:
        return None
    try:
        gid = grp.getgrnam(name).gr_gid
    except KeyError:
        raise RunError(
            f"ARENA_GROUP: got {name}, expected the name of a group of this computer (see `getent group`)"
        ) from None
    if os.geteuid() != 0 and gid not in {os.getegid(), *os.getgroups()}:
        raise RunError(
            f"ARENA_GROUP: this user does not belong to the group {name}: `sudo usermod -aG {name} $USER`, then log in again"
        )
    return gid


def share_folder(folder: Path, gid: int) -> None:
    """Allow the members of a group to read a folder, but not to write to it."""
    os.chown(folder, -1, gid)
    folder.chmod(0o750)


def share_file(file: Path, gid: int) -> None:
    """Allow the members of a group to read a file, but not to write to it."""
    os.chown(file, -1, gid)
    file.chmod(0o640)
