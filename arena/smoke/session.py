"""One running arena as a referee sees it: started as a user starts it, looked at from outside, ended whatever happens.

The referee is a client of the simulation clock: while it looks, time stands still. Until everything has started it lets time
pass no faster than the wall's, so that the processes that start have the machine for themselves.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from arena.clock import SimClock
from arena.errors import RunError
from arena.plan.model import Plan
from arena.rundirs import ONLY
from arena.schema.ports import LINK_BASE
from arena.smoke.chronicle import Chronicle
from arena.smoke.deeds import Doer
from arena.smoke.ears import Ears
from arena.smoke.seen import Eyes
from arena.smoke.words import Deed, Now
from arena.supervise import open_run, plan_of, proc, sweep
from arena.wire.truth import TruthReader

LOOK_S = 0.02
_UP_S, _STARTED_S, _STILL_S, _DOWN_S = 120.0, 120.0, 30.0, 120.0  # wall time, for a machine that is slow and shared
_PATIENCE_S, _POLL_S = 0.25, 0.02
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
        sets = [part for value in (*self.overrides, f"address={address}", *seeds) for part in ("--set", value)]
        return [
            sys.executable, "-m", "arena.cli", "up", str(self.arena), "--headless", "--no-report", "--speed", self.speed,
            "--runs", str(self.runs), *sets,
        ]  # fmt: skip


class Session:
    """`with Session(start) as session: while now := session.look(): ...`. Raises RunError with the words of an arena that does
    not come up. On leaving, the arena is landed and ended, and nothing of it runs.

    run: its run folder, None before there is one. ended: why there is nothing more to see. trouble: the same, where no scenario
    may bring it about.
    """

    def __init__(self, start: Start) -> None:
        self.run: Path | None = None
        self.ended = ""
        self.trouble = ""
        self._start = start
        self._rt = Path(tempfile.mkdtemp(prefix="arena-smoke-"))  # short, for socket paths
        self._said = self._rt / "up.txt"
        self._up: subprocess.Popen[bytes] | None = None
        self._clock: SimClock | None = None
        self._ears: Ears | None = None
        self._next = 0.0
        self._all_down = False

    def __enter__(self) -> Self:
        try:
            self._begin()
            self._connect()
            self._wait_for_all()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # -- while it runs

    def look(self) -> Now | None:
        """The next look, LOOK_S later in simulation time; None when there is nothing more to see, and `ended` says why."""
        if self._clock is None:
            return None
        try:
            if self._doer.commanding:
                time.sleep(LOOK_S)
            self._next = max(self._next, self._clock.now()) + LOOK_S
            self._clock.ask(self._next)
            time_s = self._awaited(self._clock)
        except RunError as error:
            self.ended = str(error)
            return None
        if time_s is None:
            self.ended = self.trouble = f"simulation time has stood still at {self._clock.now():.2f} s for {_STILL_S:g} s"
            return None
        return self._now(time_s)

    def do(self, deed: Deed) -> None:
        """Carry it out, or take it back. Raises RunError where it cannot be done."""
        self._doer.do(deed)

    def _now(self, time_s: float) -> Now:
        assert self._ears is not None
        self._ears.listen(time_s)
        events = tuple(self._chronicle.read())
        if self._up is not None and self._up.poll() is not None:
            self._chronicle.look_who_is_left()
        states = {**self._chronicle.states, "supervisor": "READY" if self._up and self._up.poll() is None else "EXITED"}
        seen = self._eyes.see(self._truth.newest(), self._ears.told, self._chronicle.crashed, time_s)
        self._all_down = all(vehicle.down for vehicle in seen.values())
        return Now(time_s=time_s, vehicles=seen, processes=states, events=events)

    def _awaited(self, clock: SimClock) -> float | None:
        """The time when it has come; None when the world stands still. Raises RunError when it has ended."""
        deadline = time.monotonic() + _STILL_S
        while (time_s := clock.told(_PATIENCE_S)) is None and time.monotonic() < deadline:
            pass
        return time_s

    # -- its beginning

    def _begin(self) -> None:
        address = free_address()
        with self._said.open("wb") as out:
            self._up = subprocess.Popen(
                self._start.argv(address), stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                start_new_session=True, env={**os.environ, ONLY: str(self._rt)},
                preexec_fn=_end_with_us,  # noqa: PLW1509  nothing else is done in it
            )  # fmt: skip

    def _connect(self) -> None:
        pointer = self._until(lambda: next(iter(self._rt.glob("*/run")), None), _UP_S, "made no run folder")
        self.run = Path(self._until(pointer.read_text, _UP_S, "made no run folder"))
        self._state = self._until(lambda: open_run(self.run) if self.run else None, _UP_S, "wrote no state.json")
        plan = plan_of(self._state)
        if plan is None:
            raise RunError(f"{self.run}: its plan.json cannot be read")
        if real := [v.name for v in plan.vehicles if not v.simulated]:
            raise RunError(f"{', '.join(real)}: real. Smoke flights spoil arenas on purpose: they fly simulated vehicles only")
        self._join(plan)

    def _join(self, plan: Plan) -> None:
        assert self.run is not None
        world = self._slice("world")
        clock = Path(f"{world['clock']}.sock")
        self._until(lambda: clock.exists() and Path(world["truth"]).exists(), _UP_S, "has no world that serves the time")
        self._clock, self._truth = SimClock(world["clock"], "smoke"), TruthReader(world["truth"])
        self._next = self._clock.now()
        self._eyes = Eyes(world["vehicles"])
        self._ears = Ears(plan.vehicles)
        self._chronicle = Chronicle(self.run, [spec.name for spec in plan.processes])
        self._doer = Doer(plan, self.run, Path(self._state.rt), self._chronicle, self._ears)

    def _slice(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((Path(self._state.run) / "slices" / f"{name}.json").read_text())
        return found

    def _wait_for_all(self) -> None:
        """Looks that nobody judges, at the wall's pace at most."""
        deadline = time.monotonic() + _STARTED_S
        while not self._chronicle.started:
            if time.monotonic() > deadline:
                waiting = [name for name, state in self._chronicle.states.items() if state in ("STOPPED", "STARTING")]
                raise RunError(f"not everything has started within {_STARTED_S:g} s: {', '.join(waiting)}")
            if self.look() is None:
                raise RunError(f"{self.ended}; {self.last_words()}")
            time.sleep(LOOK_S)

    def _until(self, check: Any, limit_s: float, what: str) -> Any:
        """The first true value. Raises RunError with the arena's own words when it ends before that."""
        deadline = time.monotonic() + limit_s
        while not (value := check()):
            if self._up is not None and self._up.poll() is not None:
                raise RunError(f"the arena did not come up (exit {self._up.returncode}): {self.last_words()}")
            if time.monotonic() > deadline:
                raise RunError(f"the arena {what} within {limit_s:g} s: {self.last_words()}")
            time.sleep(_POLL_S)
        return value

    def last_words(self) -> str:
        """The end of what `arena up` has said."""
        with contextlib.suppress(OSError):
            return "\n".join(self._said.read_text(errors="replace").splitlines()[-8:])
        return ""

    # -- its end

    def close(self) -> None:
        """Land, end, leave nothing. Interrupted meanwhile, it kills what is left and lets the interruption pass."""
        if self._ears is not None:
            self._ears.close()
        try:
            self._end()
        finally:
            self._leave_clock()
            before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTIONS)
            self._kill_rest()
            self._keep_words()
            shutil.rmtree(self._rt, ignore_errors=True)
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def outcome(self) -> dict[str, Any]:
        """outcome.json of an arena that has ended; {} where a killed supervisor wrote none."""
        try:
            found = json.loads((self.run / "outcome.json").read_text()) if self.run else {}
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _end(self) -> None:
        """As a user would: what a scenario has stopped goes on, then SIGTERM, or a sweep where the supervisor has died."""
        if self._up is None:
            return
        for pid in self._processes():
            _signal(pid, signal.SIGCONT)
        if not self._all_down:  # let time go on as fast as it can, for the landing
            self._leave_clock()
        if self._up.poll() is None:
            self._up.send_signal(signal.SIGTERM)
            self._slowly(self._up, time.monotonic() + _DOWN_S)
        elif self.run is not None and (state := open_run(self.run)) is not None:
            with self._said.open("a") as out, contextlib.suppress(RunError):
                sweep(state, lambda text: print(text, file=out, flush=True))

    def _slowly(self, up: subprocess.Popen[bytes], deadline: float) -> None:
        """Until it has ended, at the wall's pace where nobody flies any more: a world that races on would only take its core."""
        while up.poll() is None and time.monotonic() < deadline:
            try:
                if self._clock is not None:
                    self._clock.ask(self._clock.now() + _POLL_S)
                    self._clock.told(_POLL_S)
            except RunError:
                self._leave_clock()
            time.sleep(_POLL_S)

    def _leave_clock(self) -> None:
        if self._clock is not None:
            self._clock.close()
            self._clock = None

    def _kill_rest(self) -> None:
        if self._up is not None and self._up.poll() is None:
            self._up.kill()
        for _ in range(3):  # one that was about to start another when it was killed
            for pid in self._processes():
                _signal(pid, signal.SIGKILL)
        if self._up is not None:
            self._up.wait()

    def _keep_words(self) -> None:
        if self.run is not None:
            with contextlib.suppress(OSError):
                shutil.copyfile(self._said, self.run / "logs" / "up.txt")

    def _processes(self) -> Iterator[int]:
        """Everybody whom this run has started, by the environment they were started with."""
        mark = f"{ONLY}={self._rt}"
        for pid in (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()):
            if pid != os.getpid() and mark in proc.environment(pid) and not proc.is_zombie(pid):
                yield pid


def free_address() -> str:
    """127.99.x.y, on which no router listens. Begins at one that this process alone looks at first."""
    first = os.getpid()
    for number in range(first, first + 1000):
        address = f"127.99.{number // 250 % 250}.{number % 250 + 1}"
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe, contextlib.suppress(OSError):
            probe.bind((address, LINK_BASE))
            return address
    raise RunError("no loopback address of 127.99.0.0/16 is free: are a thousand arenas up?")


def _end_with_us() -> None:
    """In the child: a referee that is killed ends its arena as a SIGTERM would."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def _signal(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)
