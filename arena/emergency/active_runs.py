"""Search for active runs of this user and of other users. A run is active while one of its processes exists.

The search reads files only, and needs no running process.
"""

from __future__ import annotations

import contextlib
import json
import pwd
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arena.run_dirs import pointers, pointers_of_others

_UPTIME = Path("/proc/stat")
_CONNECT_S = 0.2


@dataclass(frozen=True, kw_only=True)
class ActiveRun:
    """Run of an arena of which at least one process still exists.

    folder: run folder
    runtime: runtime folder, with a copy of plan.json in case that the run folder cannot be read
    owner: name of the user who started the run; "" if it is this user
    """

    folder: Path
    runtime: Path | None = None
    owner: str = ""

    def __str__(self) -> str:
        return f"{self.folder} of user {self.owner}" if self.owner else str(self.folder)


def active_runs() -> list[ActiveRun]:
    """Return the active runs of this user, oldest first.

    A run is active if one of its processes still exists.
    """
    return _active((pointer, "") for pointer in pointers())


def active_runs_of_others() -> dict[int, list[ActiveRun]]:
    """Return the active runs of other users: user id -> runs of that user, oldest first.

    Only users whose runtime folders this user may read are included.
    """
    found: dict[int, list[tuple[Path, str]]] = {}
    for pointer, owner in pointers_of_others():
        found.setdefault(owner, []).append((pointer, user_name(owner)))
    return {owner: runs for owner, given in found.items() if (runs := _active(given))}


def user_name(uid: int) -> str:
    """Return the name of a user; the id as text if the user has no name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _active(given: Iterable[tuple[Path, str]]) -> list[ActiveRun]:
    found = []
    for pointer, owner in given:
        with contextlib.suppress(OSError):
            run = ActiveRun(folder=Path(pointer.read_text().strip()), runtime=pointer.parent, owner=owner)
            if _is_active(run):
                found.append((pointer.stat().st_mtime, run))
    return [run for _, run in sorted(found, key=lambda item: item[0])]


def _is_active(run: ActiveRun) -> bool:
    """Return whether at least one process of the run still exists.

    If the run folder has been deleted, the run is active if its supervisor accepts connections. If this user may not read
    the run folder, it is enough that the runtime folder was made after the computer was started. The run may then have
    ended already, but landing such a run does no harm.
    """
    state = run.folder / "state.json"
    try:
        if state.is_file():
            return _has_running_process(state)
    except PermissionError:
        return _accepts_connections(run) or _is_of_this_boot(run)
    return (run.runtime is not None and (run.runtime / "plan.json").exists()) and _accepts_connections(run)


def _has_running_process(state: Path) -> bool:
    """Return whether at least one process recorded in state.json exists.

    Returns True if this is uncertain, because landing a run that has ended does no harm.
    """
    try:
        raw = json.loads(state.read_text())
        members: list[Any] = [raw["supervisor"], *raw["processes"].values()]
        return any(Path(f"/proc/{member['pid']}").exists() for member in members)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return True


def _accepts_connections(run: ActiveRun) -> bool:
    """Return whether the supervisor of a run accepts connections on its control socket."""
    if run.runtime is None:
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(_CONNECT_S)
        try:
            client.connect(str(run.runtime / "control.sock"))
        except OSError:
            return False
    return True


def _is_of_this_boot(run: ActiveRun) -> bool:
    """Return whether a run was started after the last start of this computer.

    Otherwise the run is over: no process survives a restart of the computer. Returns True if the times cannot be read.
    """
    try:
        lines = _UPTIME.read_text().splitlines()
        booted_s = next(float(line.split()[1]) for line in lines if line.startswith("btime "))
        return run.runtime is not None and (run.runtime / "run").stat().st_mtime >= booted_s
    except (OSError, ValueError, StopIteration):
        return True
