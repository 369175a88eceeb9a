"""The process `px4.<vehicle>`, which runs one PX4 SITL: `python -m arena.px4 FILE.json`.

PX4 runs in a folder of its own. This process starts PX4, logs PX4's output, and reports when PX4 is ready. It
ends PX4 if the world has ended or the supervisor requests a stop. Without its simulator, PX4 would use one
CPU core forever.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import selectors
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from arena.clock import SimClock
from arena.constants import PX4_HOME
from arena.errors import RunError
from arena.process_context import ProcessContext, run_process
from arena.process_ties import set_death_signal
from arena.transport import open_udp

LOCK = "/tmp/px4_lock-{instance}"
"""PX4's lock file. PX4 ignores TMPDIR."""
READY_LINE = b"Startup script returned successfully"
_PREFIX = "PX4_"
_STOP_TIMEOUT_S = 2.0
_START_WARNING_S = 20.0  # if READY_LINE is missing for this time, report it
# After a stop of this length the vehicle has fallen, but a continued PX4 would still estimate that it flies.
_MAX_STOPPED_S = 5.0


def main() -> int:
    """Run the process `px4.<vehicle>` and return its exit code."""
    return run_process("px4", lambda context: partial(serve, context))


def serve(context: ProcessContext) -> int:
    """Run PX4 until PX4 or the simulated world ends, or a stop is requested.

    Return 0 if a stop was requested or the world ended, 1 if PX4 ended by itself.
    """
    s = context.settings
    check_free(s)
    folder = make_folder(s)
    world = None
    with contextlib.suppress(RunError):  # without a world, PX4 waits for one
        world = SimClock(s["clock"], context.name)
        leave_core_of(world.server_pid)
    argv = [*s["argv"], "-d", "-i", str(s["instance"]), "-w", str(folder), str(folder / "etc")]
    env = environment(s, os.environ)
    ignored = sorted(name for name in os.environ.keys() - env.keys() - {PX4_HOME} if name.startswith(_PREFIX))
    if ignored:
        print(f"px4: environment variables that PX4 does not get: {', '.join(ignored)}", flush=True)
    print(" ".join(argv), flush=True)
    process = subprocess.Popen(
        argv,
        env=env,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=partial(set_death_signal, signal.SIGKILL),  # noqa: PLW1509 - this process has one thread
    )
    try:
        return _watch(context, process, world)
    finally:
        _end(process)


def environment(s: dict[str, Any], given: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables with which PX4 is started: variables of this process, and settings of the vehicle.

    Variables `PX4_...` of the user's shell are left out: PX4's startup scripts read them, so they could select another airframe or
    simulator, set parameters, or scale the times of failsafes.
    given: environment variables of this process.
    """
    return {
        **{name: value for name, value in given.items() if not name.startswith(_PREFIX)},
        **{f"PX4_PARAM_{name}": param_text(value) for name, value in s["params"].items()},
        "PX4_SIM_MODEL": s["model"],
        **s.get("env", {}),
    }


def leave_core_of(world_pid: int) -> None:
    """Bind this process and PX4 to CPU cores that the world does not use.

    `arena/sim/pacing.py` binds the world to its cores. PX4 inherits this binding. Otherwise the kernel would
    wake PX4 on the core that sends its sensors, and interrupt the world.
    """
    with contextlib.suppress(OSError):  # it has ended
        others = os.sched_getaffinity(0) - os.sched_getaffinity(world_pid)
        if others:
            os.sched_setaffinity(0, others)


def _watch(context: ProcessContext, process: subprocess.Popen[bytes], world: SimClock | None) -> int:
    """Log PX4's output and report its state to the supervisor, until PX4 or the simulated world ends.

    Return the exit code of this process.
    """
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    selector = selectors.DefaultSelector()
    selector.register(process.stdout, selectors.EVENT_READ)
    tail, ready, slow_at, ran_at = b"", False, time.monotonic() + _START_WARNING_S, time.monotonic()
    while not context.stopping:
        for _ in selector.select(0.2):
            output = process.stdout.read()
            if output == b"":  # PX4 has closed it
                selector.unregister(process.stdout)
            sys.stdout.buffer.write(output or b"")
            sys.stdout.flush()
            tail = (tail + (output or b""))[-4096:]
            if READY_LINE in tail and not ready:
                ready = True
                context.ready()
        code = process.poll()
        if code is not None and not context.stopping:
            return _report_end(context, end_of(code), None if ready else last_line(tail))
        if not is_stopped(process.pid):
            ran_at = time.monotonic()
        elif time.monotonic() - ran_at > _MAX_STOPPED_S:
            process.kill()
            process.wait()
            return _report_end(
                context,
                f"paused by a signal such as SIGSTOP for {_MAX_STOPPED_S:g} s, then killed",
                None if ready else last_line(tail),
            )
        if world is not None and world.ended():
            return 0
        if not ready and time.monotonic() > slow_at:
            slow_at = float("inf")
            _report(context, f"PX4 is not ready after {_START_WARNING_S:g} s. {last_line(tail)}")
    return 0


def is_stopped(pid: int) -> bool:
    """Return whether a child process is paused by a signal such as SIGSTOP, but not by a debugger."""
    with contextlib.suppress(ChildProcessError):  # it has just ended
        return os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    return False


def end_of(code: int) -> str:
    """Return a text about an exit code, such as `exit 1` or `killed by SIGKILL`."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit {code}"


def _report_end(context: ProcessContext, why: str, before_ready: str | None) -> int:
    """Report that PX4 has ended. Return the exit code of this process.

    before_ready: text about PX4's last line, if PX4 was never ready; else None
    """
    if before_ready is None:
        _report(context, f"PX4 has ended by itself ({why}); nothing flies this vehicle any more")
    else:
        _report(
            context,
            f"PX4 ended before it was ready ({why}): start its binary by hand to see why. {before_ready}",
        )
    context.stats({"ended": why})
    return 1


def _report(context: ProcessContext, text: str) -> None:
    text = f"{context.settings['vehicle']}: {text}"
    print(f"px4: {text}", file=sys.stderr, flush=True)
    context.event(text)


def last_line(output: bytes) -> str:
    """Return a sentence that quotes the last line of PX4's output, for messages about a failed start."""
    lines = [line.strip() for line in output.decode(errors="replace").splitlines() if line.strip()]
    return f"Its last line: {lines[-1]}" if lines else "It has printed nothing"


def _end(process: subprocess.Popen[bytes]) -> None:
    """Stop PX4 with SIGINT, so that PX4 saves its log. After a time-out, kill PX4 with SIGKILL.

    PX4 ignores SIGINT while it waits for a simulator.
    """
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def param_text(value: float) -> str:
    """Return a parameter value as text for PX4's `param set`. Integers have no decimal point."""
    return str(int(value)) if float(value).is_integer() and not isinstance(value, float) else repr(value)


def make_folder(s: dict[str, Any]) -> Path:
    """Create the folder in which PX4 runs, and return its path.

    Its subfolder `etc` contains links to the installed files, except the startup scripts given in the configuration. It is made again
    at a restart of PX4; PX4's logs and parameters are kept.
    """
    folder, data = Path(s["folder"]), Path(s["data"])
    if (folder / "etc").exists():
        shutil.rmtree(folder / "etc")
    scripts = folder / "etc" / "init.d-posix"
    scripts.mkdir(parents=True)
    for entry in data.iterdir():
        if entry.name != "init.d-posix":
            (folder / "etc" / entry.name).symlink_to(entry)
    for entry in (data / "init.d-posix").iterdir():
        if entry.name not in s["scripts"]:
            (scripts / entry.name).symlink_to(entry)
    for name, content in s["scripts"].items():
        (scripts / name).write_text(content)
        (scripts / name).chmod(0o755)
    return folder


def check_free(s: dict[str, Any]) -> None:
    """Raise RunError if another process uses the lock file or a UDP port that this PX4 needs.

    The error names this process if it is known.
    """
    stand_in = s.get("stand_in", False)
    if not stand_in and _is_locked(Path(LOCK.format(instance=s["instance"]))):
        owner = _lock_owner(s["instance"])
        raise RunError(
            f"PX4 instance {s['instance']} is already running{owner}: stop it, or give this vehicle another id"
        )
    for name, link in s["links"].items():
        host, port = link["local"]
        where = "" if stand_in else "; PX4 needs the port on every address of this computer"
        try:
            open_udp((host if stand_in else "0.0.0.0", port)).close()
        except OSError as error:
            why = f"the {name} link's UDP port {port} is taken{_holder(port)} ({error.strerror}){where}"
            raise RunError(why) from error


def _is_locked(lock: Path) -> bool:
    """Return whether a running PX4 holds the lock file. False if the PX4 that created the file was killed."""
    try:
        file = lock.open("rb")
    except OSError:  # no such file; or another user's, which PX4 itself will report
        return False
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def _holder(port: int) -> str:
    """Return a text that names the process that has bound a UDP port, for a message; "" if unknown.

    For example: ` by process 123 (px4) on 0.0.0.0`.
    """
    import psutil

    with contextlib.suppress(psutil.Error):
        for connection in psutil.net_connections("udp4"):
            if connection.laddr and connection.laddr[1] == port and connection.pid:
                return f" by process {connection.pid} ({psutil.Process(connection.pid).name()}) on {connection.laddr[0]}"
    return ""


def _lock_owner(instance: int) -> str:
    """Return a text that names the running PX4 process with this instance number, for a message.

    For example: ` as process 123 (px4 -i 0)`. Return "" if there is no such process.
    """
    import psutil

    for process in psutil.process_iter(["name", "cmdline", "pid"]):
        line = process.info["cmdline"] or []
        if (
            line
            and Path(line[0]).name == "px4"
            and "-i" in line
            and line[line.index("-i") + 1 :][:1] == [str(instance)]
        ):
            return f" as process {process.info['pid']} ({' '.join(line)})"
    return ""


if __name__ == "__main__":
    sys.exit(main())
