"""Readiness probes, which find when a starting process is ready.

A probe looks for a report of the process, its start, an open port, a text in its log, a file, or a delay.
"""

from __future__ import annotations

import re
from pathlib import Path

from arena.plan.model import ProcessSpec
from arena.supervisor import proc_fs
from arena.supervisor.child_process import Child
from arena.supervisor.process_state import ProcessStatus, State

_LOG_BYTES = 1 << 20
"""Length of the end of a log that is searched [bytes]."""


def proof_of(child: Child | None, status: ProcessStatus, now: float, *, reported: bool) -> str:
    """Return why a starting process counts as ready, such as "reported ready", or "" if it is not ready.

    child: the running process; None if it has ended. now: monotonic [s]. reported: the process has reported that it is ready.
    """
    if status.state is not State.STARTING:
        return ""
    if child is None:
        return "reported ready" if reported else ""
    alive_s = now - status.since
    return proof(
        child.spec, pid=child.pid, log=child.log, offset=child.log_start, alive_s=alive_s, reported=reported
    )


def proof(spec: ProcessSpec, *, pid: int, log: Path, offset: int, alive_s: float, reported: bool) -> str:
    """Return why a running process counts as ready, such as "reported ready", or "" if it is not ready.

    spec: the process, with all placeholders filled. pid: of the process.
    log: its log file. offset: size of the log file when this process was started [byte]: older lines are of earlier starts.
    alive_s: time since the start [s]. reported: the process has reported that it is ready.
    """
    match spec.ready:
        case "reported":
            return "reported ready" if reported else ""
        case "started":
            return "started"
        case "port":
            return f"serves port {spec.ready_port}" if proc_fs.serves_port(pid, spec.ready_port) else ""
        case "file":
            return f"the file {spec.ready_value} exists" if Path(spec.ready_value).exists() else ""
        case "delay":
            return f"ran for {spec.ready_value} s" if alive_s >= float(spec.ready_value) else ""
        case "log":
            line = matching_line(log, offset, spec.ready_value)
            return f"printed: {line}" if line else ""


def matching_line(log: Path, offset: int, pattern: str) -> str:
    """Return the first line of a log that matches a regular expression, or "" if no line matches.

    The search begins at a byte offset.
    """
    try:
        with log.open("rb") as file:
            file.seek(max(offset, log.stat().st_size - _LOG_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    expression = re.compile(pattern)
    return next((line.strip() for line in lines if expression.search(line)), "")
