"""One running arena, started as a user starts it and ended whatever happens."""

from __future__ import annotations

import contextlib
import ctypes
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
from arena.smoke.flying.observer import LOOK_S, Observer, slice_of
from arena.supervisor import open_run, plan_of, proc_fs
from arena.supervisor.child_process import RUN
from arena.transport import open_udp

T = TypeVar("T")
_UP_S, _DOWN_S, _LEFT_S, _KILLED_S = 120.0, 120.0, 10.0, 20.0  # wall time: machines may be slow
_POLL_S = 0.02
_INTERRUPTIONS = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


@dataclass(frozen=True, kw_only=True)
class Start:
    """How an arena is started. arena: its YAML. overrides: `key=value`, as `--set`. runs: where its run folder goes.

    speed: as `arena up --speed`. seed: of the world and the motion capture, None: as the YAML says.
    """

    arena: Path
    runs: Path
    overrides: Sequence[str] = ()
    speed: str = "max"
    seed: int | None = None

    def argv(self, address: str) -> list[str]:
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
            *sets,
        ]


class Session:
    """`with Session(start) as session: while now := session.look(): ...`. Raises RunError with the words of an arena that does
    not come up. On leaving, the arena is landed and ended, and nothing of it runs.

    run: its run folder, None before there is one.
    """

    def __init__(self, start: Start) -> None:
        self.run: Path | None = None
        self._start = start
        self._rt = Path(tempfile.mkdtemp(prefix="arena-smoke-"))  # short, for socket paths
        self._said = self._rt / "up.txt"
        self._up: subprocess.Popen[bytes] | None = None
        self._seat: Observer | None = None

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
    def seat(self) -> Observer:
        """Raises RunError before there is an arena, and after."""
        if self._seat is None:
            raise RunError("no arena is up")
        return self._seat

    def outcome(self) -> dict[str, Any]:
        """outcome.json of an arena that has ended; {} where a killed supervisor wrote none."""
        try:
            found = json.loads((self.run / "outcome.json").read_text()) if self.run else {}
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    # -- its beginning

    def _begin(self) -> None:
        with self._said.open("wb") as out:
            self._up = subprocess.Popen(
                self._start.argv(free_address()),
                stdout=out,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                env=self._env(),
                preexec_fn=_end_with_us,  # noqa: PLW1509  nothing else is done in it
            )

    def _connected(self) -> Observer:
        pointer = self._until(lambda: next(iter(self._rt.glob("*/run")), None), "made no run folder")
        run = self.run = Path(self._until(pointer.read_text, "made no run folder"))
        state = self._until(lambda: open_run(run), "wrote no state.json")
        plan = plan_of(state)
        if plan is None:
            raise RunError(f"{run}: its plan.json cannot be read")
        if real := [v.name for v in plan.vehicles if not v.simulated]:
            raise RunError(
                f"{', '.join(real)}: real. Smoke flights spoil arenas on purpose: they fly simulated vehicles only"
            )
        world = slice_of(run, "world")
        pages = (Path(f"{world['clock']}.sock"), Path(world["truth"]))
        self._until(lambda: all(page.exists() for page in pages), "has no world that serves the time")
        self._seat = Observer(plan, state)
        return self._seat

    def _wait_for_all(self, seat: Observer) -> None:
        """Looks that nobody judges, at the wall's pace at most: what is starting has need of the machine."""
        deadline = time.monotonic() + _UP_S
        while not seat.chronicle.started:
            if time.monotonic() > deadline:
                waiting = [
                    name for name, state in seat.chronicle.states.items() if state in ("STOPPED", "STARTING")
                ]
                raise RunError(f"not everything has started within {_UP_S:g} s: {', '.join(waiting)}")
            if seat.look() is None:
                raise RunError(f"{seat.ended}; {self._last_words()}")
            time.sleep(LOOK_S)

    def _until(self, check: Callable[[], T | None], what: str) -> T:
        """The first true value. Raises RunError with the arena's own words when it ends before that."""
        deadline = time.monotonic() + _UP_S
        while not (value := check()):
            if self._up is not None and self._up.poll() is not None:
                raise RunError(
                    f"the arena did not come up (exit {self._up.returncode}): {self._last_words()}"
                )
            if time.monotonic() > deadline:
                raise RunError(f"the arena {what} within {_UP_S:g} s: {self._last_words()}")
            time.sleep(_POLL_S)
        return value

    def _last_words(self) -> str:
        """The end of what `arena up` has said."""
        with contextlib.suppress(OSError):
            return "\n".join(self._said.read_text(errors="replace").splitlines()[-8:])
        return ""

    # -- its end

    def close(self) -> None:
        """Land, end, leave nothing. Interrupted meanwhile, it kills what is left and lets the interruption pass."""
        try:
            self._end()
        finally:
            before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTIONS)
            self._leave()
            self._kill_rest()
            self._tidy()
            shutil.rmtree(self._rt, ignore_errors=True)
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _end(self) -> None:
        """As a user would: what a scenario has stopped goes on, then SIGTERM, or `arena down` where the supervisor has died."""
        if self._up is None:
            return
        for pid in self._processes():
            _signal(pid, signal.SIGCONT)
        all_down = self._seat is not None and self._seat.all_down
        if not all_down:
            self._leave()  # for a landing time goes as fast as it can
        if self._up.poll() is None:
            self._up.send_signal(signal.SIGTERM)
            self._linger(lambda: self._up is not None and self._up.poll() is None, _DOWN_S)
        elif all_down:  # what is left ends by itself
            self._linger(lambda: any(self._processes()), _LEFT_S)
        elif self.run is not None and open_run(self.run) is not None:
            argv = [sys.executable, "-m", "arena.cli", "down", "--run", str(self.run)]
            with self._said.open("ab") as out, contextlib.suppress(subprocess.TimeoutExpired):
                subprocess.run(
                    argv, stdout=out, stderr=subprocess.STDOUT, env=self._env(), timeout=_DOWN_S, check=False
                )

    def _linger(self, check: Callable[[], bool], limit_s: float) -> None:
        """While it holds, at the wall's pace where nobody flies any more: a world that races on would only take its core."""
        deadline = time.monotonic() + limit_s
        while check() and time.monotonic() < deadline:
            if self._seat is not None:
                self._seat.linger(_POLL_S)
            else:
                time.sleep(_POLL_S)

    def _leave(self) -> None:
        if self._seat is not None:
            self._seat.leave()
            self._seat = None

    def _kill_rest(self) -> None:
        """Until nobody is left: a killed process goes when the kernel finds time for it."""
        if self._up is not None and self._up.poll() is None:
            self._up.kill()
            self._up.wait()
        deadline = time.monotonic() + _KILLED_S
        while (left := list(self._processes())) and time.monotonic() < deadline:
            for pid in left:
                _signal(pid, signal.SIGKILL)
            time.sleep(_POLL_S)

    def _tidy(self) -> None:
        """What it said stays; nobody shall look for who was running."""
        if self.run is not None:
            with contextlib.suppress(OSError):
                shutil.copyfile(self._said, self.run / "logs" / "up.txt")
                (self.run / "state.json").unlink(missing_ok=True)

    def _processes(self) -> Iterator[int]:
        """Everybody whom this run has started: those on record, and those who were started with its marks."""
        recorded = {self._up.pid} if self._up is not None and self._up.poll() is None else set()
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
        """The mark comes last: a process that takes a title may write it over its environment."""
        return {
            **{key: value for key, value in os.environ.items() if key != RUNTIME_DIR_VARIABLE},
            RUNTIME_DIR_VARIABLE: str(self._rt),
        }


def free_address() -> str:
    """127.99.x.y, on which no router listens. Begins at one that this process alone looks at first."""
    first = os.getpid()
    for number in range(first, first + 1000):
        address = f"127.99.{number // 250 % 250}.{number % 250 + 1}"
        with contextlib.suppress(OSError):
            open_udp((address, LINK_BASE)).close()
            return address
    raise RunError("no loopback address of 127.99.0.0/16 is free: are a thousand arenas up?")


def _end_with_us() -> None:
    """In the child: a referee that is killed ends its arena as a SIGTERM would."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def _signal(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)
