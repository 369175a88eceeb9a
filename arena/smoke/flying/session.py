"""Starts an arena with `arena up` for one flight, and ends all its processes after the flight."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from arena.errors import RunError
from arena.run_dirs import RUNTIME_DIR_VARIABLE
from arena.schema.ports import LINK_BASE
from arena.smoke.flying import arena_up
from arena.smoke.flying.observer import OBSERVATION_PERIOD_S, Observer, slice_of
from arena.supervisor import open_run, plan_of, proc_fs
from arena.supervisor.child_process import RUN
from arena.supervisor.forked_child import ForkedChild
from arena.transport import open_udp

T = TypeVar("T")
# wall time; machines may be slow
START_TIMEOUT_S, STOP_TIMEOUT_S, SELF_END_TIMEOUT_S, KILL_TIMEOUT_S = 120.0, 120.0, 10.0, 20.0
SETTLE_S, SETTLE_SPEED = 1.5, 4.0
"""Simulation time in which the estimates of the autopilots become valid [s], and the largest speed of the simulation meanwhile."""
_POLL_S = 0.02
_INTERRUPTIONS = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


@dataclass(frozen=True, kw_only=True)
class LaunchOptions:
    """Options of `arena up`: the arena's YAML, the folder for run folders, speed and seed.

    arena: YAML file of the arena.
    runs: folder in which the run folder is created.
    overrides: `key=value` texts, as `arena up --set`.
    speed: simulated seconds per second, or "max", as `arena up --speed`.
    seed: seed of the world and the motion capture; None: as the YAML file says.
    arguments: further arguments of `arena up`.
    """

    arena: Path
    runs: Path
    overrides: Sequence[str] = ()
    speed: str = "max"
    seed: int | None = None
    arguments: Sequence[str] = ()

    def argv(self, address: str) -> list[str]:
        """Return the command line of `arena up`.

        address: loopback address for the ports of the arena.
        """
        seeds = [] if self.seed is None else [f"world.seed={self.seed}", f"mocap.seed={self.seed}"]
        sets = [
            part for value in (*self.overrides, f"address={address}", *seeds) for part in ("--set", value)
        ]
        return [
            sys.executable,
            "-m",
            "arena.cli",
            "up",
            str(self.arena),
            "--headless",
            "--no-report",
            "--speed",
            self.speed,
            "--runs",
            str(self.runs),
            *self.arguments,
            *sets,
        ]


class Session:
    """Context manager that starts an arena and ends it.

        with Session(options) as session:
            while observation := session.observer.observe(): ...

    Entering raises RunError, with the output of `arena up`, if the arena does not start. Leaving lands the vehicles and
    ends all processes of the arena.
    run: path of the run folder; None before it exists.
    """

    def __init__(self, options: LaunchOptions) -> None:
        self.run: Path | None = None
        self._options = options
        self._rt = Path(tempfile.mkdtemp(prefix="arena-smoke-"))  # short, for socket paths
        self._output = self._rt / "up.txt"
        self._arena_up: subprocess.Popen[bytes] | ForkedChild | None = None
        self._observer: Observer | None = None

    def __enter__(self) -> Self:
        try:
            self._begin()
            self._wait_for_all(self._connected())
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def observer(self) -> Observer:
        """The observer of the running arena. Raises RunError if this session has no running arena."""
        if self._observer is None:
            raise RunError("this session has no running arena. Use the session in a `with` statement")
        return self._observer

    def outcome(self) -> dict[str, Any]:
        """Return the content of outcome.json after the end of the arena. Return {} if the file is missing.

        It is missing, for example, after SIGKILL of the supervisor.
        """
        try:
            found = json.loads((self.run / "outcome.json").read_text()) if self.run else {}
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    @property
    def has_outcome(self) -> bool:
        """True if the ended arena has written an outcome.json that can be read."""
        return bool(self.outcome())

    def run_to_end(self, limit_s: float) -> int:
        """Start the arena, wait until it ends by itself, and return the exit code of `arena up`.

        Nothing observes this arena.

        limit_s: longest wall time [s].
        Raises RunError if the arena does not start, or does not end in time.
        """
        try:
            old = set(self._options.runs.glob("*/plan.json"))
            self._begin()
            runs = self._options.runs
            found = self._until(lambda: set(runs.glob("*/plan.json")) - old, "made no run folder")
            self.run = found.pop().parent
            if self._arena_up is None:
                raise RunError("this session has no running arena. Use the session in a `with` statement")
            return self._arena_up.wait(limit_s)
        except subprocess.TimeoutExpired:
            raise RunError(
                f"the arena did not end within {limit_s:g} s of wall time: it was stopped"
            ) from None
        finally:
            self.close()

    # -- start

    def _begin(self) -> None:
        self._arena_up = arena_up.start(self._options.argv(free_address()), self._env(), self._output)

    def _connected(self) -> Observer:
        pointer = self._until(lambda: next(iter(self._rt.glob("*/run")), None), "made no run folder")
        run = self.run = Path(self._until(pointer.read_text, "made no run folder"))
        state = self._until(lambda: open_run(run), "wrote no state.json")
        plan = plan_of(state)
        if plan is None:
            raise RunError(
                f"cannot read {run}/plan.json, in which `arena up` lists the processes: {self._last_output()}"
            )
        if real := [v.name for v in plan.vehicles if not v.simulated]:
            raise RunError(
                f"got real vehicles ({', '.join(real)}), expected simulated ones: scenarios inject faults"
            )
        world = slice_of(run, "world")
        pages = (Path(f"{world['clock']}.sock"), Path(world["truth"]))
        self._until(lambda: all(page.exists() for page in pages), "started no world")
        self._observer = Observer(plan, state)
        return self._observer

    def _wait_for_all(self, observer: Observer) -> None:
        """Observe the run until all processes have started. Raises RunError if that takes too long or the arena ends.

        The simulation runs at most in real time meanwhile, because the starting processes need the CPU. In the first
        SETTLE_S it may be faster, because all processes wait for the estimates of the autopilots.
        """
        deadline = time.monotonic() + START_TIMEOUT_S
        while not observer.run_log.started:
            if time.monotonic() > deadline:
                waiting = [
                    name
                    for name, state in observer.run_log.states.items()
                    if state in ("STOPPED", "STARTING")
                ]
                raise RunError(
                    f"these processes did not start within {START_TIMEOUT_S:g} s: {', '.join(waiting)}"
                )
            if (seen := observer.observe()) is None:
                raise RunError(f"the arena ended during its start: {observer.ended}; {self._last_output()}")
            time.sleep(OBSERVATION_PERIOD_S / (SETTLE_SPEED if seen.time_s < SETTLE_S else 1.0))

    def _until(self, check: Callable[[], T | None], what: str) -> T:
        """Call the function `check` repeatedly until it returns a true value, and return that value.

        what: the end of the error message "the arena ...", such as "made no run folder".

        Raises RunError, with the output of `arena up`, if the arena ends first or START_TIMEOUT_S has passed.
        """
        deadline = time.monotonic() + START_TIMEOUT_S
        while not (value := check()):
            if self._arena_up is not None and self._arena_up.poll() is not None:
                raise RunError(
                    f"the arena did not start (exit {self._arena_up.returncode}): {self._last_output()}"
                )
            if time.monotonic() > deadline:
                raise RunError(f"the arena {what} within {START_TIMEOUT_S:g} s: {self._last_output()}")
            time.sleep(_POLL_S)
        return value

    def _last_output(self) -> str:
        """Return the last lines of the output of `arena up`."""
        with contextlib.suppress(OSError):
            return "\n".join(self._output.read_text(errors="replace").splitlines()[-8:])
        return ""

    # -- end

    def close(self) -> None:
        """Land the vehicles and end the arena.

        At an interrupt, kill the remaining processes and raise the interrupt again.
        """
        try:
            self._end()
        finally:
            before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTIONS)
            self._disconnect()
            self._kill_remaining()
            self._tidy()
            shutil.rmtree(self._rt, ignore_errors=True)
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _end(self) -> None:
        """End the arena with SIGTERM, or with `arena down` if the supervisor is dead.

        Before that, processes paused by SIGSTOP are continued.
        """
        if self._arena_up is None:
            return
        for pid in self._processes():
            _signal(pid, signal.SIGCONT)
        all_down = self._observer is not None and self._observer.all_down
        if not all_down:
            self._disconnect()  # let the landing run at full speed
        if self._arena_up.poll() is None:
            self._arena_up.send_signal(signal.SIGTERM)
            self._idle_while(
                lambda: self._arena_up is not None and self._arena_up.poll() is None, STOP_TIMEOUT_S
            )
        elif all_down:  # the remaining processes end by themselves
            self._idle_while(lambda: any(self._processes()), SELF_END_TIMEOUT_S)
        elif self.run is not None and open_run(self.run) is not None:
            argv = [sys.executable, "-m", "arena.cli", "down", "--run", str(self.run)]
            with self._output.open("ab") as out, contextlib.suppress(subprocess.TimeoutExpired):
                subprocess.run(
                    argv,
                    stdout=out,
                    stderr=subprocess.STDOUT,
                    env=self._env(),
                    timeout=STOP_TIMEOUT_S,
                    check=False,
                )

    def _idle_while(self, check: Callable[[], bool], limit_s: float) -> None:
        """Wait while the function `check` returns true, for at most `limit_s` of wall time.

        While an observer is connected (no vehicle flies), the world runs in real time, because a faster one wastes CPU time.
        """
        deadline = time.monotonic() + limit_s
        while check() and time.monotonic() < deadline:
            if self._observer is not None:
                self._observer.idle(_POLL_S)
            else:
                time.sleep(_POLL_S)

    def _disconnect(self) -> None:
        if self._observer is not None:
            self._observer.close()
            self._observer = None

    def _kill_remaining(self) -> None:
        """Kill the processes of this run until none is left."""
        if self._arena_up is not None and self._arena_up.poll() is None:
            self._arena_up.kill()
            self._arena_up.wait()
        deadline = time.monotonic() + KILL_TIMEOUT_S
        while (left := list(self._processes())) and time.monotonic() < deadline:
            for pid in left:
                _signal(pid, signal.SIGKILL)
            time.sleep(_POLL_S)

    def _tidy(self) -> None:
        """Copy the output of `arena up` to logs/up.txt in the run folder, and delete state.json.

        The run has ended, so state.json is no longer needed.
        """
        if self.run is not None:
            with contextlib.suppress(OSError):
                shutil.copyfile(self._output, self.run / "logs" / "up.txt")
                (self.run / "state.json").unlink(missing_ok=True)

    def _processes(self) -> Iterator[int]:
        """Yield the pids of all processes that this run has started.

        These are the processes in state.json and all processes with the path of the run in their environment.
        """
        recorded = (
            {self._arena_up.pid} if self._arena_up is not None and self._arena_up.poll() is None else set()
        )
        if self.run is not None and (state := open_run(self.run)) is not None:
            recorded |= {pid for pids in state.survivors().values() for pid in pids}
        marks = {
            f"{RUNTIME_DIR_VARIABLE}={self._rt}",
            *([f"{RUN}={self.run}"] if self.run is not None else []),
        }
        for pid in (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()):
            ours = pid in recorded or not marks.isdisjoint(proc_fs.environment(pid))
            if ours and pid != os.getpid() and not proc_fs.is_zombie(pid):
                yield pid

    def _env(self) -> dict[str, str]:
        """Return the environment variables for `arena up`.

        ARENA_RUNTIME_DIR is the last one, because setting a process title can overwrite the first ones.

        ARENA_RUNTIME_DIR must stay readable for other processes.
        """
        return {
            **{key: value for key, value in os.environ.items() if key != RUNTIME_DIR_VARIABLE},
            RUNTIME_DIR_VARIABLE: str(self._rt),
        }


def free_address() -> str:
    """Return an address 127.99.x.y on which no router listens.

    The first address that is tried depends on the process id.
    """
    first = os.getpid()
    for number in range(first, first + 1000):
        address = f"127.99.{number // 250 % 250}.{number % 250 + 1}"
        with contextlib.suppress(OSError):
            open_udp((address, LINK_BASE)).close()
            return address
    raise RunError(
        "no free loopback address found in 1000 addresses of 127.99.0.0/16: end some of the running arenas"
    )


def _signal(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)
