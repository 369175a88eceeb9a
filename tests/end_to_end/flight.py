"""A running arena for tests, started by the command line as a user starts it, with access to its truth and records."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from arena.clock import SimClock
from arena.errors import RunError
from arena.process_ties import set_death_signal
from arena.report.run_report import write_summary
from arena.smoke.flying.arena_up import start_interpreter
from arena.supervisor import Control, RunState, open_run, proc_fs
from arena.wire.truth_page import Truth, TruthReader

from . import warm_process

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).parent / "programs"
STANDS_M = 0.03
"""Height above its start position below which a body counts as standing [m]."""


PATIENCE = 3.0
"""Factor on all time limits, for a machine that is shared and slow."""
PACE_S = 0.02
"""Simulated time between two waits of `Flight.paced` [s]."""
LEAST_S = 30.0
"""Least time limit of a wait for an event [s]: starting one process can take so long on a starved machine."""


def eventually(check: Callable[[], Any], limit_s: float, what: str, tell: Callable[[], object] = str) -> Any:
    """Poll `check` and return its first true value; fail at the deadline with `what` and the result of `tell`."""
    limit_s = max(LEAST_S, PATIENCE * limit_s)
    deadline = time.monotonic() + limit_s
    while time.monotonic() < deadline:
        if value := check():
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {limit_s:g} s: {what}\n{tell()}")


end_with_us = partial(set_death_signal, signal.SIGTERM)
"""Lets the kernel send SIGTERM to this child process when the test process dies, even by SIGKILL."""


def started_by(run: Path) -> set[int]:
    mark = f"ARENA_RUN={run}"
    return {pid for pid in psutil.pids() if not proc_fs.is_zombie(pid) and mark in proc_fs.environment(pid)}


def arena_yaml(folder: Path, address: str, vehicles: dict[str, str], more: str = "") -> Path:
    """Write an arena of vehicles 2 m apart. vehicles: name -> argument of `programs/fly.py`."""
    lines = [
        "name: flight",
        f"address: {address}",
        "world: {size: [14, 6, 3]}",
        "defaults: {autopilot: builtin}",
        "vehicles:",
    ]
    for i, (name, then) in enumerate(vehicles.items()):
        north = 2.0 * i - len(vehicles) + 1
        program = f"{{path: '{PROGRAMS / 'fly.py'}', args: [{then}]}}"
        lines.append(f"  {name}: {{start: {{position: [{north:g}, 0, 0]}}, program: {program}}}")
    file = folder / "arena.yaml"
    file.write_text("\n".join(lines) + "\n" + more)
    return file


class Flight:
    """One `arena up` on one address. `end` kills whatever is left of it.

    cold: whether a new interpreter runs it, as for a user. Otherwise it is a fork of a process that has imported the packages.
    """

    def __init__(
        self, yaml: Path, address: str, *options: str, folder: Path, runtime: Path, cold: bool
    ) -> None:
        self.address, self.runs, self._runtime = address, folder / "runs", runtime
        self.began = time.monotonic()
        self.out = folder / f"out-{len(list(folder.glob('out-*')))}.txt"
        self._before = set(self.runs.glob("*"))
        up = (
            "up",
            str(yaml),
            "--headless",
            "--runs",
            str(self.runs),
            "--set",
            f"address={address}",
            *(() if "--speed" in options else ("--realtime",)),  # two arenas share two cores
            *options,
        )
        with self.out.open("wb") as out:
            command, env = self._command(*up), self._env()
            self.process = (
                start_interpreter(command, env, out.fileno())
                if cold
                else warm_process.start(command, env=env, output=out.fileno())
            )
        self._truth: TruthReader | None = None
        self._stood_d = np.empty(0)

    # -- records on disk

    @cached_property
    def folder(self) -> Path:
        """Return the run folder; wait until the run has begun or ended."""

        def made() -> Path | None:
            over, new = self.process.poll() is not None, set(self.runs.glob("*")) - self._before
            assert new or not over, f"nothing was started: {self.said()}"
            return next(
                (p for p in new if (p / "state.json").exists() or (p / "outcome.json").exists()), None
            )

        return eventually(made, 20, "a run folder", self.said)

    def json(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text())

    @property
    def outcome(self) -> dict[str, Any]:
        return self.json("outcome.json")

    @property
    def summary(self) -> dict[str, Any]:
        """Return the content of summary.json. If the flight made no report, write the summary first."""
        if not (self.folder / "summary.json").exists():
            assert self.process.poll() is not None, "the run has not ended"
            write_summary(self.folder)
        return self.json("summary.json")

    def stats(self, process: str) -> dict[str, Any]:
        return self.outcome["processes"][process]["stats"]

    def verdict(self, vehicle: str) -> dict[str, Any]:
        return self.stats("world")["vehicles"][vehicle]

    def events(self, process: str = "") -> list[dict[str, Any]]:
        file = self.folder / "events.jsonl"
        whole = file.read_text().rpartition("\n")[0] if file.exists() else ""  # it may be about to be written
        lines = whole.splitlines()
        return [e for e in map(json.loads, lines) if process in ("", e["process"])]

    def log(self, name: str) -> str:
        file = self.folder / "logs" / f"{name}.log"
        return file.read_text(errors="replace") if file.exists() else ""

    def rows(self, vehicle: str) -> list[dict[str, str]]:
        """Return the rows of the vehicle's CSV, which is made from the record if the supervisor has died before the report."""
        path = self.folder / "csv" / f"{vehicle}.csv"
        if not path.exists():
            subprocess.run(
                [sys.executable, "-m", "arena.flight_log", str(self.folder)], check=True, timeout=120
            )
        with path.open() as file:
            return list(csv.DictReader(file))

    def said(self) -> str:
        return self.out.read_text(errors="replace")

    # -- while it runs

    @property
    def state(self) -> RunState:
        return eventually(lambda: open_run(self.folder), 10, "state.json", self.said)

    def pid(self, process: str) -> int:
        return self.state.processes[process].pid

    def status(self) -> dict[str, Any]:
        return Control(Path(self.state.rt, "control.sock")).ask(do="ps")

    def fact(self, name: str) -> Any:
        return self.status()["facts"].get(name)

    def truth(self) -> Truth:
        """Return the newest truth. After a first call it can be read when the world has ended, too."""
        if self._truth is None:
            world = self.json("slices/world.json")
            page = Path(world["truth"])
            eventually(page.exists, 20, "a truth page", self.said)
            self._truth = TruthReader(page)
            eventually(self._truth.newest, 10, "a first truth")
            # not the first truth, which a fast simulation may write in the air
            self._stood_d = np.array(
                [v["position"][2] - v["profile"]["ground_clearance_m"] for v in world["vehicles"]]
            )
        found = self._truth.newest()
        assert found is not None
        return found

    def heights(self) -> NDArray[np.float64]:
        """Return the height of each vehicle above its start position [m] (V,)."""
        now = self.truth()
        return self._stood_d - now.p_n[:, 2]

    def until_up(self, height_m: float = 0.5, limit_s: float = 30.0) -> None:
        """Wait until every vehicle is above this height."""
        eventually(
            lambda: self.heights().min() > height_m or self._ended(), limit_s, "all in the air", self.said
        )

    def until_down(self, limit_s: float) -> None:
        """Wait until the truth shows every vehicle on the floor."""
        eventually(lambda: self.heights().max() < STANDS_M, limit_s, "all on the floor", self.heights)

    def until_disarmed(self, vehicles: Iterable[str], limit_s: float) -> None:
        """Wait until the router reports these vehicles disarmed."""
        wanted = [f"{v}.armed" for v in vehicles]
        eventually(
            lambda: not any(self.status()["facts"][w] for w in wanted),
            limit_s,
            f"disarmed: {wanted}",
            self.said,
        )

    def until_said(self, words: str, limit_s: float) -> None:
        eventually(lambda: words in self.said(), limit_s, f"{words!r} said", self.said)

    def until_event(self, process: str, to: str, limit_s: float, times: int = 1) -> dict[str, Any]:
        """Wait for the n-th transition of a process into a state and return its event; `times` is n."""

        def found() -> list[dict[str, Any]]:
            return [e for e in self.events(process) if e.get("to") == to]

        return eventually(
            lambda: len(found()) >= times and found()[times - 1], limit_s, f"{process} {to}", self.said
        )

    @contextlib.contextmanager
    def paced(self, speed: float) -> Iterator[None]:
        """Limit the simulation to this speed (simulated time per real time) during the block.

        The arena must be in lockstep, which is any `--speed` but 1.
        """
        assert PACE_S / speed < 0.5, "the world drops a client that does not sleep for 1 s"
        clock, ended = SimClock(self.json("slices/world.json")["clock"], "test"), threading.Event()
        failure: list[RunError] = []

        def limit() -> None:
            while not ended.wait(PACE_S / speed):
                try:
                    clock.request_wake(clock.now() + PACE_S)
                    while clock.wait_for_wake(0.5) is None and not ended.is_set():
                        pass
                except RunError as error:
                    failure.append(error)
                    return

        clock.sleep_only(clock.now() + PACE_S)  # from now on the world waits
        thread = threading.Thread(target=limit, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(10.0)
            clock.close()
        assert not failure, f"the world ended: {failure}"

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self, limit_s: float = 60.0) -> int:
        try:
            return self.process.wait(PATIENCE * limit_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still running after {limit_s:g} s: {self.said()}") from None

    def cli(self, *arguments: str, limit_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Run another `arena` command, as from another terminal."""
        return subprocess.run(
            self._command(*arguments),
            capture_output=True,
            text=True,
            timeout=PATIENCE * limit_s,
            check=False,
            env=self._env(),
        )

    def start_cli(self, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(self._command(*arguments), stdout=subprocess.PIPE, text=True, env=self._env())

    # -- leftovers

    def processes(self) -> set[int]:
        """Return the pids of all running processes of this run, found by their environment."""
        return started_by(self.folder)

    def sockets(self) -> list[Any]:
        """Return all sockets on this arena's address or motion-capture group."""
        own = {self.address, self.json("slices/mocap.json")["group"]}
        return [c for c in psutil.net_connections("inet") if c.laddr and c.laddr.ip in own]

    def assert_nothing_left(self) -> None:
        assert self.process.poll() is not None
        assert self.processes() == set() and self.sockets() == []
        assert open_run(self.folder) is None and list(self._runtime.iterdir()) == []

    def end(self) -> None:
        for member in [self.process.pid] if self.process.poll() is None else []:
            os.kill(member, signal.SIGKILL)
        self.process.wait()
        for made in set(self.runs.glob("*")) - self._before:
            for pid in started_by(made):
                os.kill(pid, signal.SIGKILL)

    def _ended(self) -> bool:
        assert self.process.poll() is None, f"ended: {self.said()}"
        return False

    def _command(self, *arguments: str) -> list[str]:
        return [sys.executable, "-m", "arena.cli", *arguments]

    def _env(self) -> dict[str, str]:
        return {**os.environ, "ARENA_RUNTIME_DIR": str(self._runtime)}


class Hangar:
    """Starts flights on one address and ends them all on `close`.

    report: whether `arena up` makes a report with plots at the end, which costs some seconds of CPU time.
    cold: whether a new interpreter runs `arena up`, as for a user, which costs some seconds of CPU time too.
    """

    def __init__(self, folder: Path, address: str, *, report: bool = False, cold: bool = False) -> None:
        self.folder, self.address, self._report, self._cold = folder, address, report, cold
        self.runtime = Path(tempfile.mkdtemp(prefix="arena-fly-"))  # short, for socket paths
        self._flights: list[Flight] = []

    def up(self, yaml: Path, *options: str) -> Flight:
        if not self._report and "--no-report" not in options:
            options = (*options, "--no-report")
        more = {"folder": self.folder, "runtime": self.runtime, "cold": self._cold}
        self._flights.append(Flight(yaml, self.address, *options, **more))
        return self._flights[-1]

    def fly(self, vehicles: dict[str, str], *options: str, more: str = "") -> Flight:
        """Start an arena. vehicles: name -> action after take-off, see `programs/fly.py`."""
        return self.up(arena_yaml(self.folder, self.address, vehicles, more), *options)

    def close(self) -> None:
        for flight in self._flights:
            flight.end()
        shutil.rmtree(self.runtime, ignore_errors=True)
