"""Search for runtime folders. A runtime folder is a private folder with the sockets of one running arena.

A runtime folder also contains the file `run`.

The file `run` contains the path of the run folder. Commands such as `arena ps` find the running arenas by these files.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

RUNTIME_DIR_VARIABLE = "ARENA_RUNTIME_DIR"
"""Environment variable for tests: the only folder in which runtime folders are created and searched."""
GROUP_VARIABLE = "ARENA_GROUP"
"""Environment variable: name of a group of the computer whose members may find and land this user's runs."""
_SILENT_WAIT_S = 1.0  # for another arena that is starting


def pointers() -> list[Path]:
    """Return one file per running arena of this user. The file contains the path of the arena's run folder.

    The files have the name `run` and are in runtime folders. Folders of other users, and folders to which others may write, are ignored.
    """
    bases = [base for base in runtime_bases() if _is_ours(base)]
    return [pointer for base in bases for pointer in sorted(base.glob("*/run")) if _is_ours(pointer.parent)]


def untrusted_folders() -> list[Path]:
    """Return this user's runtime folders that are ignored because other users may write to them.

    If others may write to the folder above them, return that folder instead. `pointers` ignores these folders.
    """
    found = []
    for base in runtime_bases():
        with contextlib.suppress(OSError):
            running = sorted(pointer.parent for pointer in base.glob("*/run"))
            if running and base.lstat().st_uid == os.getuid():
                found += [folder for folder in running if not _is_ours(folder)] if _is_ours(base) else [base]
    return found


def pointers_of_others() -> list[tuple[Path, int]]:
    """Return (file, user id) for each running arena of another user, if this user may read its runtime folder.

    The file has the name `run`, is in the runtime folder of the arena, and contains the path of its run folder.

    Root may read all. Other users may read the folders that the owner shares with a group to which they belong (mode
    0750). A folder is ignored if its path names another owner, or if others than its owner may write to it.
    """
    if os.environ.get(RUNTIME_DIR_VARIABLE):
        return []
    found = []
    for base, owner in _bases_of_others():
        if not _is_readable_folder(base, owner):
            continue
        with contextlib.suppress(OSError):
            folders = sorted(folder for folder in base.iterdir() if _is_readable_folder(folder, owner))
            found += [(folder / "run", owner) for folder in folders if _is_file_of(folder / "run", owner)]
    return found


def shared_group(folder: Path) -> int | None:
    """Return the id of the group that may read a runtime folder; None if only the owner may read it."""
    found = folder.stat()
    return found.st_gid if found.st_mode & 0o070 == 0o050 else None


def _bases_of_others() -> Iterator[tuple[Path, int]]:
    """Yield (folder, user id) for folders that may contain runtime folders of other users.

    An example is (/tmp/arena-1000, 1000).

    The user id is taken from the path. The caller must check that this user owns the folder.
    """
    own, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    users = Path("/run/user") if not xdg else Path(xdg).parent if Path(xdg).name == str(own) else None
    found = []
    for folder, pattern, below in (
        (Path(tempfile.gettempdir()), r"arena-(\d+)", ""),
        (users, r"(\d+)", "arena"),
    ):
        with contextlib.suppress(OSError):
            for path in sorted(folder.iterdir()) if folder is not None else []:
                if match := re.fullmatch(pattern, path.name, re.ASCII):
                    found.append((path / below, int(match[1])))
    yield from ((path, owner) for path, owner in found if owner != own)


def _is_readable_folder(folder: Path, owner: int) -> bool:
    """Return whether a path is a folder that only its owner may write, and that this user may read.

    owner: user id that the folder must have
    """
    try:
        found = folder.lstat()
    except OSError:
        return False
    if not _only_owner_may_write(found, owner):
        return False
    if os.geteuid() == 0:
        return True
    return found.st_mode & 0o077 == 0o050 and found.st_gid in {os.getegid(), *os.getgroups()}


def _is_file_of(path: Path, owner: int) -> bool:
    try:
        found = path.lstat()
    except OSError:
        return False
    return stat.S_ISREG(found.st_mode) and found.st_uid == owner


def _only_owner_may_write(found: os.stat_result, owner: int) -> bool:
    """Return whether a file status describes a folder of the user `owner` to which nobody else may write.

    Whoever writes to a runtime folder chooses the addresses that land-all commands.
    """
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == owner
        and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )


def _is_ours(folder: Path) -> bool:
    """Return whether a path is a folder of this user to which nobody else, not even a group, may write."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return _only_owner_may_write(found, os.getuid())


def open_lock_file(name: str) -> IO[bytes]:
    """Open a lock file of this user in the folder for temporary files. The caller locks it.

    The file is never removed, because a waiting process may have it open.
    name: file name without the user id and the ending.
    Raises OSError, also if another user has put a symbolic link in its place.
    """
    path = Path(tempfile.gettempdir()) / f"arena-{name}-{os.getuid()}.lock"
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.fdopen(os.open(path, flags, 0o600), "r+b")


def runtime_bases(*, shared: bool = False) -> list[Path]:
    """Return the folders in which this user's runtime folders are created and searched.

    New runs use the first folder.

    shared: put the folder first that other users can reach. Only its owner can reach XDG_RUNTIME_DIR.

    All are searched, because a terminal without XDG_RUNTIME_DIR must find the runs of a terminal in which it is set.
    """
    if only := os.environ.get(RUNTIME_DIR_VARIABLE):
        return [Path(only)]
    uid, xdg = os.getuid(), os.environ.get("XDG_RUNTIME_DIR", "")
    given = [Path(xdg) / "arena"] if xdg and Path(xdg).is_dir() else []
    temporary = Path(tempfile.gettempdir()) / f"arena-{uid}"
    first = [temporary, *given] if shared else [*given, temporary]
    return list(dict.fromkeys([*first, Path(f"/run/user/{uid}/arena")]))


@contextlib.contextmanager
def starting_alone(say: Callable[[str], None], limit_s: float = 20.0) -> Iterator[None]:
    """Wait until no other arena of this user is starting, then let the others wait during the `with` block.

    Two arenas that started at the same moment would choose the same free address. Within the block, an arena chooses its address and
    creates its runtime folder, by which the next one finds it. After `limit_s` the block runs without the lock: the other arena may be
    stopped by SIGSTOP. Processes with different TMPDIR do not wait for each other.
    say: function that prints a line about a longer wait.  limit_s: longest wait [s, wall time]
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # a full disk, or a lock file of another user: then without a lock
            _wait_for_lock(stack.enter_context(open_lock_file("starting")), say, limit_s)
        yield


def _wait_for_lock(file: IO[bytes], say: Callable[[str], None], limit_s: float) -> None:
    began, reported = time.monotonic(), False
    while not _lock(file):
        waited_s = time.monotonic() - began
        if waited_s > limit_s:
            say(f"another arena has been starting for {limit_s:g} s: not waiting for it any longer")
            return
        if waited_s > _SILENT_WAIT_S and not reported:
            reported = True
            say("waiting, because another arena is starting")
        time.sleep(0.02)


def _lock(file: IO[bytes]) -> bool:
    """Lock a file if no other process has locked it. Return whether it is locked now. Closing the file ends the lock."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
