"""`python -m arena.px4 slice.json`: one PX4 SITL, in a folder of its own, for as long as the world that simulates its sensors.

A real PX4 knows nothing of supervisors: left alone by its simulator it spins for ever on one core. So this process stays beside
it, writes down what it says, tells when it is up, and ends it when the world has ended or the supervisor says so.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import selectors
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from arena.clock import SimClock
from arena.errors import RunError
from arena.process_context import ProcessContext, run_room
from arena.transport import open_udp

LOCK = "/tmp/px4_lock-{instance}"
"""PX4's own lock file, whatever TMPDIR says."""
UP = b"Startup script returned successfully"
_PR_SET_PDEATHSIG = 1
_STOP_S = 2.0
_SLOW_S = 20.0  # not up for so long: say so
_STOPPED_S = (
    5.0  # by a signal for so long: its vehicle has long fallen, and it would believe for ever that it flies
)
_libc = ctypes.CDLL(None)


def main() -> int:
    return run_room("px4", lambda room: partial(serve, room))


def serve(room: ProcessContext) -> int:
    """Its exit code: 0 when told to stop or when the world ended, 1 when PX4 ended by itself."""
    s = room.settings
    check_free(s)
    folder = make_folder(s)
    world = None
    with contextlib.suppress(
        RunError
    ):  # without a world PX4 waits for one; `_watch` then has nothing to end with
        world = SimClock(s["clock"], room.name)
        leave_its_core(world.server_pid)
    argv = [*s["argv"], "-d", "-i", str(s["instance"]), "-w", str(folder), str(folder / "etc")]
    env = {
        **os.environ,
        **{f"PX4_PARAM_{name}": text(value) for name, value in s["params"].items()},
        "PX4_SIM_MODEL": s["model"],
    }
    env.pop("PX4_SIM_SPEED_FACTOR", None)  # it would rewrite the failsafes' times
    print(" ".join(argv), flush=True)
    process = subprocess.Popen(
        argv,
        env=env,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=_die_with_us,  # noqa: PLW1509 - this process has one thread
    )
    try:
        return _watch(room, process, world)
    finally:
        _end(process)


def leave_its_core(world_pid: int) -> None:
    """A world that keeps to one core (`arena/sim/pacing.py`) has it for itself: the kernel would wake PX4 on the very core that
    sends its sensors, and push the world aside. What is started from here inherits it.
    """
    with contextlib.suppress(OSError):  # it has ended
        others = os.sched_getaffinity(0) - os.sched_getaffinity(world_pid)
        if others:
            os.sched_setaffinity(0, others)


def _watch(room: ProcessContext, process: subprocess.Popen[bytes], world: SimClock | None) -> int:
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    selector = selectors.DefaultSelector()
    selector.register(process.stdout, selectors.EVENT_READ)
    tail, up, slow_at, ran_at = b"", False, time.monotonic() + _SLOW_S, time.monotonic()
    while not room.stopping:
        for _ in selector.select(0.2):
            said = process.stdout.read()
            if said == b"":  # it has closed its output
                selector.unregister(process.stdout)
            sys.stdout.buffer.write(said or b"")
            sys.stdout.flush()
            tail = (tail + (said or b""))[-4096:]
            if UP in tail and not up:
                up = True
                room.ready()
        code = process.poll()
        if code is not None and not room.stopping:
            return _tell_end(room, end_of(code), None if up else last_words(tail))
        if not is_stopped(process.pid):
            ran_at = time.monotonic()
        elif time.monotonic() - ran_at > _STOPPED_S:
            process.kill()
            process.wait()
            return _tell_end(
                room,
                f"stopped by a signal for {_STOPPED_S:g} s, then killed",
                None if up else last_words(tail),
            )
        if world is not None and world.ended():
            return 0
        if not up and time.monotonic() > slow_at:
            slow_at = float("inf")
            _tell(room, f"PX4 has not come up for {_SLOW_S:g} s. {last_words(tail)}")
    return 0


def is_stopped(pid: int) -> bool:
    """A signal keeps this child from running. It is not one when a debugger holds it."""
    with contextlib.suppress(ChildProcessError):  # it has just ended
        return os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    return False


def end_of(code: int) -> str:
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit {code}"


def _tell_end(room: ProcessContext, why: str, before_up: str | None) -> int:
    """before_up: its last words, when it was never up."""
    if before_up is None:
        _tell(room, f"PX4 has ended by itself ({why}); nothing flies this vehicle any more")
    else:
        _tell(room, f"PX4 ended before it was up ({why}): try its binary by hand. {before_up}")
    room.stats({"ended": why})
    return 1


def _tell(room: ProcessContext, text: str) -> None:
    text = f"{room.settings['vehicle']}: {text}"
    print(f"px4: {text}", file=sys.stderr, flush=True)
    room.event(text)


def last_words(output: bytes) -> str:
    """The last line that PX4 wrote, as a sentence."""
    lines = [line.strip() for line in output.decode(errors="replace").splitlines() if line.strip()]
    return f"Its last words: {lines[-1]}" if lines else "It has said nothing"


def _end(process: subprocess.Popen[bytes]) -> None:
    """SIGINT saves its log; one that waits for a simulator ignores it."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _die_with_us() -> None:
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def text(value: float) -> str:
    """A parameter's value as `param set` reads it: integers without a point."""
    return str(int(value)) if float(value).is_integer() and not isinstance(value, float) else repr(value)


def make_folder(s: dict[str, Any]) -> Path:
    """PX4's working folder: its `etc` is the installed one by links, but for the scripts that this arena writes."""
    folder, data = Path(s["folder"]), Path(s["data"])
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
    """Raises RunError, naming who is there, when this instance's lock or ports are taken."""
    stand_in = s.get("stand_in", False)
    if not stand_in and _is_locked(Path(LOCK.format(instance=s["instance"]))):
        owner = _lock_owner(s["instance"])
        raise RunError(
            f"PX4 instance {s['instance']} runs already{owner}: stop it, or give this vehicle another id"
        )
    for name, link in s["links"].items():
        host, port = link["local"]
        where = "" if stand_in else "; PX4 binds it on every address"
        try:
            open_udp((host if stand_in else "0.0.0.0", port)).close()
        except OSError as error:
            why = f"the {name} link's UDP port {port} is taken{_holder(port)} ({error.strerror}){where}"
            raise RunError(why) from error


def _is_locked(lock: Path) -> bool:
    """PX4 holds its lock while it runs. A file that nobody holds, left by one that was killed, is in nobody's way."""
    try:
        file = lock.open("rb")
    except OSError:  # there is none; or it is another user's, and PX4 itself will say so
        return False
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def _holder(port: int) -> str:
    """Who has a UDP port, where the system tells."""
    import psutil

    with contextlib.suppress(psutil.Error):
        for connection in psutil.net_connections("udp4"):
            if connection.laddr and connection.laddr[1] == port and connection.pid:
                return f" by process {connection.pid} ({psutil.Process(connection.pid).name()}) on {connection.laddr[0]}"
    return ""


def _lock_owner(instance: int) -> str:
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
