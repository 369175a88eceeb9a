"""Information about processes, read from /proc.

It is read directly, because the supervisor reads it often and must use little CPU.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


@dataclass(frozen=True, kw_only=True)
class Usage:
    """CPU time and memory that one process uses.

    cpu_s: CPU time of the process and of the children that it has waited for [s].  rss_mb: resident memory [MB].
    """

    cpu_s: float
    rss_mb: float


@cache
def boot_id() -> str:
    """Return the kernel's id of the current boot.

    Start times of processes are comparable only within one boot.
    """
    return _read("/proc/sys/kernel/random/boot_id").decode().strip()


def _read(path: str) -> bytes:
    """Return the content of a small file of /proc, or empty bytes if the process has ended."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return b""
    try:
        return os.read(fd, 1 << 16)
    except OSError:
        return b""
    finally:
        os.close(fd)


def _stat(pid: int) -> list[bytes]:
    """Return the fields of /proc/PID/stat after the process name.

    Element 0 is field 3 of proc(5), the state.
    """
    return _read(f"/proc/{pid}/stat").rpartition(b")")[2].split()


def usage(pid: int) -> Usage | None:
    """Return the CPU time and memory of a process, or None if the process does not exist."""
    fields = _stat(pid)
    if len(fields) < 22:
        return None
    return Usage(cpu_s=sum(map(int, fields[11:15])) * _TICK_S, rss_mb=int(fields[21]) * _PAGE_MB)


def start_time(pid: int) -> float | None:
    """Return the start time of a process [s since boot], or None if the process does not exist.

    The resolution is 0.01 s.

    Pid and start time together identify a process. Wall time is not used, because it jumps when the clock is set, and a
    running process would then seem to be another one.
    """
    fields = _stat(pid)
    return int(fields[19]) * _TICK_S if len(fields) >= 20 else None


def is_zombie(pid: int) -> bool:
    """Return whether a process has ended but its parent has not collected its exit status yet."""
    fields = _stat(pid)
    return bool(fields) and fields[0] in (b"Z", b"X")


def is_stopped(pid: int) -> bool:
    """Return whether a process is paused by SIGSTOP or by a debugger."""
    fields = _stat(pid)
    return bool(fields) and fields[0] in (b"T", b"t")


def is_same(pid: int, start_s: float) -> bool:
    """Return whether a pid still belongs to the process that was started at `start_s` [s since boot]."""
    found = start_time(pid)
    return found is not None and abs(found - start_s) < 0.005 and not is_zombie(pid)


def children(pid: int) -> list[int]:
    """Return the pids of the child processes that the main thread of a process has forked.

    Children of other threads are not found, because reading every thread would take too long.
    """
    return [int(x) for x in _read(f"/proc/{pid}/task/{pid}/children").split()]


def tree(pid: int, depth: int = 4) -> Iterator[int]:
    """Yield the pids of a process and its descendants.

    depth: number of generations.
    """
    yield pid
    if depth:
        for child in children(pid):
            yield from tree(child, depth - 1)


def group_members(pgid: int) -> list[int]:
    """Return the pids of the running processes of a process group.

    It is slow, because it scans all processes.
    """
    return [pid for pid, fields in _all() if int(fields[2]) == pgid and fields[0] not in (b"Z", b"X")]


def session_members(sid: int) -> list[int]:
    """Return the pids of the running processes of a session.

    It is slow, because it scans all processes.
    """
    return [pid for pid, fields in _all() if int(fields[3]) == sid and fields[0] not in (b"Z", b"X")]


def _all() -> Iterator[tuple[int, list[bytes]]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            fields = _stat(int(entry.name))
            if len(fields) >= 20:
                yield int(entry.name), fields


def environment(pid: int) -> list[str]:
    """Return the environment variables with which a process was started, as `KEY=value` entries.

    It is empty if this user cannot read it.
    """
    return [entry.decode(errors="replace") for entry in _read(f"/proc/{pid}/environ").split(b"\0")]


def serves_port(pid: int, port: int) -> bool:
    """Return whether a process or one of its descendants uses a port (TCP listening or UDP bound)."""
    inodes = _listening(port)
    return bool(inodes) and any(inodes & _socket_inodes(member) for member in tree(pid))


def _listening(port: int) -> set[bytes]:
    wanted, found = f":{port:04X}".encode(), set()
    for name, states in (
        ("tcp", (b"0A",)),
        ("tcp6", (b"0A",)),
        ("udp", (b"07", b"01")),
        ("udp6", (b"07", b"01")),
    ):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/net/{name}").read_bytes().splitlines()[1:]:
                fields = line.split()
                if fields[1].endswith(wanted) and fields[3] in states:
                    found.add(b"socket:[" + fields[9] + b"]")
    return found


def _socket_inodes(pid: int) -> set[bytes]:
    found = set()
    with contextlib.suppress(OSError):
        for entry in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                found.add(str(entry.readlink()).encode())
    return found
