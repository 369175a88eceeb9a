"""Child processes of the supervisor: start, signals, and exit status.

Each child has its own session and process group; signals go to the group. A child that must not outlive the
supervisor gets a parent-death signal. The kernel sends this signal when the *thread* that forked ends. Therefore
start children from the main thread only.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import stat
import subprocess
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from arena.background_writer import within
from arena.plan.model import ProcessSpec
from arena.process_context import SOCKET_VARIABLE
from arena.process_ties import set_death_signal
from arena.supervisor import proc_fs
from arena.supervisor.fork_client import ForkClient
from arena.supervisor.process_state import Exit

LOG_LIMIT_BYTES = 64 << 20
LOG_KEPT_BYTES = 1 << 20
OPEN_TIMEOUT_S = 0.5
RUN, PROCESS = "ARENA_RUN", "ARENA_PROCESS"
_PACKET_BYTES = 1 << 18
_PACKETS_PER_CALL = 64
_AUTOGROUP = Path("/proc/self/autogroup")


@dataclass(kw_only=True)
class Child:
    """Process that the supervisor has started, with its log file and status socket.

    pid: also the number of its process group and session.  start_s: when the kernel started it [s since boot].
    channel: the supervisor's end of the status socket; None once the other end is closed.
    garbage: number of packets that were not JSON objects.
    log: its log file; /dev/null if the file could not be opened, so that nobody waits for its disk.
    log_start: size of the log file when the process was started [byte].
    cut: how often the log file was shortened.
    cpu_s: CPU time of the process and its children [s]; 0 until `reap` returns an Exit.
    forked: the fork server started it, so its packages are already imported.
    stopped: name of the signal that paused it, found by the last `reap`; "" if not paused. A pause by a debugger does
        not count.
    """

    spec: ProcessSpec
    pid: int
    start_s: float
    log: Path
    channel: socket.socket | None
    garbage: int = 0
    log_start: int = 0
    cut: int = 0
    cpu_s: float = 0.0
    forked: bool = False
    stopped: str = ""
    _popen: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _kept: deque[dict[str, Any]] = field(default_factory=deque, repr=False)

    def signal(self, number: int) -> None:
        """Send a signal to the whole process group. Do nothing if the group has ended."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)

    def reap(self) -> Exit | None:
        """Return how the process ended, or None while it runs.

        If it ended: kill the other processes of its group before its pid is released, so that no new group can have the
        same number.
        """
        try:
            found = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return Exit(code=1, text="ended; its exit code is unknown, because something else waited for it")
        if found is None or found.si_code == os.CLD_STOPPED:
            self.stopped = _signal_name(found.si_status) if found is not None else ""
            return None
        self.signal(signal.SIGKILL)
        _, status, used = os.wait4(self.pid, 0)
        self.cpu_s = used.ru_utime + used.ru_stime
        if self._popen is not None:
            self._popen.returncode = os.waitstatus_to_exitcode(status)
        exit = exit_of(status)
        return replace(exit, last_line=last_line(self.log, self.log_start)) if exit.code else exit

    def receive(self) -> list[dict[str, Any]]:
        """Return the packets from the process's status socket: facts, events, readiness.

        It returns at most _PACKETS_PER_CALL packets.

        Data that is not a JSON object is counted in `garbage`. At end of file `channel` becomes None.
        """
        packets: list[dict[str, Any]] = []
        for _ in range(_PACKETS_PER_CALL):
            data = self._receive_bytes()
            if not data:
                break
            try:
                packet = json.loads(data)
            except (ValueError, RecursionError):
                packet = None
            if isinstance(packet, dict):
                packets.append(packet)
            else:
                self.garbage += 1
        return packets

    def _receive_bytes(self) -> bytes:
        if self.channel is None:
            return b""
        try:
            data = self.channel.recv(_PACKET_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def send(self, packet: dict[str, Any], *, keep: bool = False) -> bool:
        """Send a request to the process. Return False if it cannot be sent now.

        It cannot be sent if the process has ended or does not read its socket, or if an earlier request is still kept.

        keep: keep a request that cannot be sent now. `send_kept` sends it.
        """
        sent = self.send_kept() and self._send(packet)
        if keep and not sent:
            self._kept.append(packet)
        return sent

    def send_kept(self) -> bool:
        """Send the requests that were kept because they could not be sent. Return whether none is left."""
        while self._kept and self._send(self._kept[0]):
            self._kept.popleft()
        return not self._kept

    def _send(self, packet: dict[str, Any]) -> bool:
        if self.channel is None:
            return False
        try:
            self.channel.send(json.dumps(packet).encode())
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the status socket."""
        if self.channel is not None:
            self.channel.close()
            self.channel = None

    def cut_log(self) -> bool:
        """Cut a log file longer than LOG_LIMIT_BYTES to LOG_KEPT_BYTES. Return whether it was cut.

        The child has the file open for appending, so the child continues to write at the new end.
        """
        with contextlib.suppress(OSError):
            if self.log.stat().st_size > LOG_LIMIT_BYTES:
                os.truncate(self.log, LOG_KEPT_BYTES)
                self.cut += 1
                return True
        return False


def start(spec: ProcessSpec, log: Path, run: str, forks: ForkClient | None = None) -> Child:
    """Start a process of the plan: with the fork server if possible, else by fork and exec. Raises OSError.

    spec: the process, with all placeholders filled; its `env` is added to the supervisor's environment.
    log: file to which the output of the process is appended. If it cannot be opened, the output is dropped, because a process
        that vehicles need must start also with a disk that is full or does not respond.
    run: path of the run folder, for the environment variable ARENA_RUN.
    forks: client of the fork server; None without a fork server.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    output = _open_log(log)
    opened = os.fstat(output)
    is_file = stat.S_ISREG(opened.st_mode)
    env = {**os.environ, **dict(spec.env), RUN: run, PROCESS: spec.name}
    try:
        ours.setblocking(False)
        forked = None if forks is None else _fork(forks, spec, env, output, theirs)
        popen = None if forked is not None else _execute(spec, env, output, theirs)
    except (OSError, subprocess.SubprocessError, ValueError):
        ours.close()
        raise
    finally:
        theirs.close()
        os.close(output)
    pid = forked if popen is None else popen.pid
    assert pid is not None
    return Child(
        spec=spec,
        pid=pid,
        start_s=proc_fs.start_time(pid) or 0.0,
        log=log if is_file else Path(os.devnull),
        channel=ours,
        log_start=opened.st_size,
        forked=popen is None,
        _popen=popen,
    )


def _fork(
    forks: ForkClient, spec: ProcessSpec, env: dict[str, str], output: int, channel: socket.socket
) -> int | None:
    """Request a process from the fork server. Return its pid, or None if the fork server cannot start it."""
    if not forks.serves(spec.argv, is_program=spec.is_program, cwd=spec.cwd):
        return None
    return forks.fork(
        spec.argv,
        cwd=spec.cwd,
        env=env,
        socket_variable=SOCKET_VARIABLE,
        nice=spec.nice,
        death_signal=0 if spec.outlives else signal.SIGKILL,
        output=output,
        channel=channel.fileno(),
    )


def _execute(
    spec: ProcessSpec, env: dict[str, str], output: int, channel: socket.socket
) -> subprocess.Popen[bytes]:
    """Start a process of the plan without the fork server, by fork and exec."""
    return subprocess.Popen(
        spec.argv,
        cwd=spec.cwd if Path(spec.cwd).is_dir() or not spec.outlives else "/",
        env={**env, SOCKET_VARIABLE: str(channel.fileno())},
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        pass_fds=(channel.fileno(),),
        preexec_fn=_before_exec(spec),  # noqa: PLW1509  there is one thread
    )


def _open_log(log: Path) -> int:
    """Open a log file for appending. Open /dev/null if this fails or takes longer than OPEN_TIMEOUT_S."""
    opened = within(OPEN_TIMEOUT_S, partial(_open_or_null, log), discard=os.close)
    return _open_null() if opened is None else opened


def _open_or_null(log: Path) -> int:
    """Open a log file for appending, or /dev/null if this fails.

    A deleted folder is created again.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
    with contextlib.suppress(OSError):
        return os.open(log, flags, 0o644)
    with contextlib.suppress(OSError):
        log.parent.mkdir()
        return os.open(log, flags, 0o644)
    return _open_null()


def _open_null() -> int:
    return os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)


def last_line(log: Path, start: int = 0) -> str:
    """Return the last non-blank line of a log file after the byte `start`, or "" if there is none."""
    try:
        with log.open("rb") as file:
            file.seek(max(start, log.stat().st_size - 4096))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def exit_of(status: int) -> Exit:
    """Convert the wait status of a process to an Exit with a text such as `exit 1` or `killed by SIGKILL`."""
    code = os.waitstatus_to_exitcode(status)
    if code >= 0:
        return Exit(code=code, text=f"exit {code}")
    return Exit(code=128 - code, text=f"killed by {_signal_name(-code)}")


def reap_adopted(known: set[int], mark: str, alive: set[str]) -> list[int]:
    """Kill orphaned processes, whose parent was a process of the plan and has ended.

    Collect their exit status and return their pids.

    known: pids that the supervisor started itself; these are not touched.
    mark: `KEY=value` entry that every process of this run has in its environment.
    alive: names of the running processes; their descendants are not killed.
    """
    killed = []
    for pid in proc_fs.children(os.getpid()):
        if pid in known:
            continue
        environment = proc_fs.environment(pid)
        if mark in environment and not any(f"{PROCESS}={name}" in environment for name in alive):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
            killed.append(pid)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, 0 if pid in killed else os.WNOHANG)
    return killed


def _before_exec(spec: ProcessSpec) -> Callable[[], None] | None:
    """Return the function that a new child process runs between fork and exec, or None if nothing must be done.

    Without such a function the start is faster, because vfork is used.
    """
    if spec.outlives and not spec.nice and not os.getpriority(os.PRIO_PROCESS, 0):
        return None
    supervisor, nice, dies_with_us = os.getpid(), spec.nice, not spec.outlives

    def prepare() -> None:
        if dies_with_us:
            set_death_signal(signal.SIGKILL)
            if os.getppid() != supervisor:  # it died before the call above
                os._exit(1)
        with contextlib.suppress(OSError):
            os.nice(nice)  # added to the caller's
        if found := os.getpriority(os.PRIO_PROCESS, 0):
            # With autogroups the kernel gives every session an equal share of the CPU. The nice values of processes
            # have no effect between sessions, so set the nice value of the autogroup.
            with contextlib.suppress(OSError):
                _AUTOGROUP.write_text(str(found))

    return prepare


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
