"""The process table: what happens when a process is killed (SIGKILL) or stopped (SIGSTOP), on the ground and in the air.

A sortie is one flight of one arena; it tests one or more cells. Cells share a sortie only if they cannot influence each
other: they hit processes of different vehicles, or processes that no vehicle needs. In the air all signals are sent 3 s
after take-off. On the ground they are sent one after another before arming; then the vehicles take off.
`benchmarks/processes.py` prints the measured table; `test_process_*.py` checks it.
"""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

from .flight import PROGRAMS, STANDS_M, Flight, Hangar, eventually

Signal = Literal["SIGKILL", "SIGSTOP"]
Where = Literal["air", "ground"]

TOUCHDOWN_M_S, DRIFT_M = 1.0, 0.3
"""Limits of every landing; above 1.5 m/s the world reports a crash."""
STAY_S, _LONG_S = 6.0, 600.0
_AFTER_S = 3.0
_SINKING_M_S = 0.2


class End(StrEnum):
    """How the flight of a vehicle ends."""

    FLIES = "flies on, and lands as its program says"
    LANDS = "lands: no setpoints (`offboard_loss`)"
    BLIND = "lands blind: no poses (`position_loss`)"
    COMMANDED = "lands: commanded"
    FALLS = "falls: its motors stop"
    STAYS = "stays on the ground"
    GONE = "gone with its world"


class Fate(StrEnum):
    """Result for the killed or stopped process."""

    AGAIN = "started again"
    ENDED = "not started again"
    ALONE = "reported, left alone"
    KILLED = "killed after 1 s, started again"
    LOST = "the arena ends"
    ORPHANS = "programs end with it; other processes end after the landing"
    UNSEEN = "not detected: `arena down` ends the arena"
    TWICE = "a second `arena land-all` confirms"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One cell of the table.

    fate: what happens to the process.
    own: end of the vehicle that the process belongs to; processes of the whole arena belong to every vehicle.
    others: end of the other vehicles.
    else_: second allowed end of `own`, where the speed of the machine decides whether a restart beats the failsafe.
    code: exit code of `arena up`; None when it was killed.
    """

    process: str
    signal: Signal
    where: Where
    fate: Fate
    own: End
    others: End
    else_: End | None = None
    code: int | None = 0

    def __str__(self) -> str:
        return f"{self.process} {self.signal} {self.where}"


def _cells() -> Iterator[Cell]:
    """Yield the cells.

    A row: process; (fate, own, others, exit code) for SIGKILL in the air, SIGSTOP in the air, SIGKILL on the
    ground, SIGSTOP on the ground.
    """
    F, L, B, C, X, S, G = End
    A, E, O, K, W, R, U, T = Fate  # noqa: E741
    rows = (
        ("supervisor", (R, L, L, None), (U, C, C, None), (R, S, S, None), (U, F, F, None)),
        ("world", (W, G, G, 1), (W, G, G, 1), (W, G, G, 1), (W, G, G, 1)),
        ("mocap", (A, F, F, 0, B), (K, B, B, 1, F), (A, F, F, 0), (K, F, F, 0)),
        ("router", (A, F, F, 0, L), (K, L, L, 1, F), (A, F, F, 0), (K, F, F, 0)),
        ("forward.<v>", (A, F, F, 0, B), (K, B, F, 1, F), (A, F, F, 0), (K, F, F, 0)),
        ("recorder", (A, F, F, 0), (K, F, F, 0), (A, F, F, 0), (K, F, F, 0)),
        ("program.<v>", (E, L, F, 1), (O, L, F, 0), (E, S, F, 1), (O, S, F, 0)),
        ("tool.<name>", (E, F, F, 0), (O, F, F, 0), (E, F, F, 0), (O, F, F, 0)),
        ("px4.<v>", (E, X, F, 1), (O, F, F, 0), (E, S, F, 1), (O, F, F, 0)),
        ("PX4 of <v>", (E, X, F, 1), (E, X, F, 1), (E, S, F, 1), (E, S, F, 1)),
        ("copilot", (W, C, C, 1), (W, C, C, 1), (W, S, S, 1), (W, S, S, 1)),
        ("land-all", (T, C, C, 1), (T, C, C, 1), (T, S, S, 1), (T, S, S, 1)),
    )
    for process, *columns in rows:
        for (where, number), (fate, own, others, code, *else_) in zip(_COLUMNS, columns, strict=True):
            yield Cell(
                process=process,
                signal=number,
                where=where,
                fate=fate,
                own=own,
                others=others,
                code=code,
                else_=else_[0] if else_ else None,
            )


_COLUMNS: tuple[tuple[Where, Signal], ...] = (
    ("air", "SIGKILL"),
    ("air", "SIGSTOP"),
    ("ground", "SIGKILL"),
    ("ground", "SIGSTOP"),
)
CELLS = tuple(_cells())


@dataclass(frozen=True)
class Hit:
    """A cell applied to one process. target: name in the plan, `PX4 of uav1`, or `land-all`."""

    cell: Cell
    target: str

    @property
    def vehicle(self) -> str | None:
        return f"uav{self.target.rpartition('uav')[2]}" if "<v>" in self.cell.process else None


@dataclass(frozen=True, kw_only=True)
class Sortie:
    """One flight of one arena.

    speed: value of `--speed`. "1" (real time) where a restart in flight is measured, because starting a process takes wall time.
    px4: vehicles that fly PX4 or its stand-in.
    stay_s: time that programs hover [s]; long where a command lands the vehicles.
    more: further lines of the YAML.
    """

    name: str
    where: Where
    hits: tuple[Hit, ...]
    vehicles: int = 2
    px4: tuple[str, ...] = ()
    speed: str = "max"
    stay_s: float = STAY_S
    more: str = ""

    def expected(self) -> dict[str, set[End]]:
        """Return the allowed ends of each vehicle."""
        found: dict[str, set[End]] = {}
        for name in self.names:
            own = [h.cell for h in self.hits if h.vehicle == name] or [
                h.cell for h in self.hits if h.vehicle is None
            ]
            ends = {c.own for c in own} or {h.cell.others for h in self.hits}
            late = {c.else_ for c in own if c.else_ is not None}
            found[name] = (ends if len(ends) == 1 else ends - {End.FLIES}) | late
        return found

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"uav{i + 1}" for i in range(self.vehicles))

    @property
    def codes(self) -> int | None:
        """Return the expected exit code of the run if no vehicle meets `else_`."""
        codes = [h.cell.code for h in self.hits]
        return None if None in codes else max(code for code in codes if code is not None)


def _hit(process: str, number: Signal, where: Where, target: str) -> Hit:
    (cell,) = (c for c in CELLS if (c.process, c.signal, c.where) == (process, number, where))
    return Hit(cell, target)


def _both(process: str, where: Where, first: str, second: str) -> tuple[Hit, Hit]:
    return _hit(process, "SIGKILL", where, first), _hit(process, "SIGSTOP", where, second)


def _sorties() -> Iterator[Sortie]:
    for where in ("air", "ground"):
        for process in ("supervisor", "world"):
            for number in ("SIGKILL", "SIGSTOP"):
                stays = (process, number, where) == ("supervisor", "SIGSTOP", "air")
                yield Sortie(
                    name=f"{process} {number} {where}",
                    where=where,
                    hits=(_hit(process, number, where, process),),
                    stay_s=_LONG_S if stays else STAY_S,
                )
        for number in ("SIGKILL", "SIGSTOP"):
            yield Sortie(
                name=f"copilot {number} {where}",
                where=where,
                hits=(_hit("copilot", number, where, "copilot"),),
                stay_s=_LONG_S,
                speed="1",
                more="copilot: {}",
            )
        programs = _both("program.<v>", where, "program.uav1", "program.uav2")
        yield Sortie(name=f"programs {where}", where=where, vehicles=3, hits=programs)
        for kind, target in (("px4.<v>", "px4.uav"), ("PX4 of <v>", "PX4 of uav")):
            px4s = _both(kind, where, f"{target}1", f"{target}2")
            yield Sortie(
                name=f"{kind} {where}", where=where, vehicles=3, hits=px4s, px4=("uav1", "uav2"), speed="1"
            )
    tools = _both("tool.<name>", "air", "tool.one", "tool.two")
    killed, stopped = _both("recorder", "air", "recorder", "recorder")
    yield Sortie(name="bystanders air", where="air", vehicles=3, hits=(killed, *tools))
    forwarders = _both("forward.<v>", "air", "forward.uav1", "forward.uav2")
    yield Sortie(name="forwarders air", where="air", vehicles=3, hits=(*forwarders, stopped), speed="1")
    for process in ("mocap", "router", "land-all"):
        for number in ("SIGKILL", "SIGSTOP"):
            yield Sortie(
                name=f"{process} {number} air",
                where="air",
                hits=(_hit(process, number, "air", process),),
                speed="1",
                stay_s=_LONG_S if process == "land-all" else STAY_S,
            )
    yield Sortie(
        name="land-all ground", where="ground", hits=_both("land-all", "ground", "land-all", "land-all")
    )
    shared = [h for p in ("mocap", "router", "recorder") for h in _both(p, "ground", p, p)]
    owned = _both("forward.<v>", "ground", "forward.uav1", "forward.uav1")
    tools = _both("tool.<name>", "ground", "tool.one", "tool.two")
    yield Sortie(name="all that is started again, ground", where="ground", hits=(*shared, *owned, *tools))


SORTIES = tuple(_sorties())
# Flown at every `make test`; `make nightly` flies them all.
DAILY = {"programs air", "forwarders air", "router SIGKILL air", "all that is started again, ground"}


def cells(where: Where, *, px4_only: bool = False) -> list[Any]:
    """Return one pytest parameter per cell that ends there; cells of sorties outside DAILY are marked nightly."""
    return [
        pytest.param(sortie, hit, id=str(hit.cell), marks=[] if sortie.name in DAILY else pytest.mark.nightly)
        for sortie in SORTIES
        if sortie.where == where and (sortie.px4 or not px4_only)
        for hit in sortie.hits
    ]


@dataclass(kw_only=True)
class Track:
    """The observed flight of one vehicle.

    sank_s: time from the signal to the descent [s].
    touchdown_m_s, drift_m: None without a landing.
    """

    end: End
    sank_s: float | None = None
    touchdown_m_s: float | None = None
    drift_m: float | None = None
    crashed: str = ""


@dataclass(kw_only=True)
class Flown:
    """The observed result of one sortie. fates: hit -> what happened to the process."""

    sortie: Sortie
    tracks: dict[str, Track]
    code: int | None
    fates: dict[Hit, Fate | None] = field(default_factory=dict)
    said: str = ""


# -- flying --------------------------------------------------------------------------------------------------------------------


def fly(sortie: Sortie, hangar: Hangar, *options: str, first_id: int = 1) -> Flown:
    """Fly a sortie and return what was observed.

    Raises AssertionError when an expected change does not come or a process is left running.
    """
    return _Flying(sortie, hangar, options, first_id).run()


class _Flying:
    def __init__(self, sortie: Sortie, hangar: Hangar, options: tuple[str, ...], first_id: int) -> None:
        self.sortie, self.go = sortie, hangar.folder / "go"
        self.go.unlink(missing_ok=True)
        if sortie.where == "air":
            self.go.touch()
        speed = () if sortie.speed == "1" else ("--speed", sortie.speed)
        self.flight = hangar.up(_yaml(sortie, hangar, self.go, first_id), "--no-report", *speed, *options)
        self.expected = sortie.expected()
        self.fates: dict[Hit, Fate | None] = {}
        self.programs: dict[str, int] = {}
        self.others: list[subprocess.Popen[str]] = []

    def run(self) -> Flown:
        flight = self.flight
        for name in self.sortie.names:
            flight.until_event(f"program.{name}", "READY", 60)
        wanted = [f"program.{name}" for name in self.sortie.names]
        eventually(
            lambda: set(wanted) <= set(flight.state.processes), 10, "the programs in state.json", flight.said
        )
        self.programs = {name: flight.pid(f"program.{name}") for name in self.sortie.names}
        for name in self.sortie.px4:
            flight.until_event(f"px4.{name}", "READY", 60)
        flight.truth()
        if self.sortie.where == "air":
            flight.until_up(0.5, 60)
            up = flight.truth().time_s
            eventually(lambda: flight.truth().time_s >= up + _AFTER_S, 30, "3 s of flight", flight.said)
        at = flight.truth().time_s
        for hit in self.sortie.hits:
            self._hit(hit)
        if not (self._is_hit("world") or self._is_hit("copilot")):  # the arena is ending
            self.go.touch()
        self._until_over(at)
        code = self._end()
        tracks = {name: self._track(name, at) for name in self.sortie.names}
        return Flown(sortie=self.sortie, tracks=tracks, code=code, fates=self.fates, said=flight.said())

    def _hit(self, hit: Hit) -> None:
        flight, number = self.flight, getattr(signal, hit.cell.signal)
        if hit.target == "land-all":
            self._hit_land_all(number, hit)
            return
        seen = len(flight.events(hit.target))
        os.kill(self._pid(hit), number)
        self.fates[hit] = self._fate(hit, seen) if hit.target != "supervisor" else hit.cell.fate

    def _pid(self, hit: Hit) -> int:
        if hit.target == "supervisor":
            return self.flight.process.pid
        if not hit.target.startswith("PX4 of "):
            return self.flight.pid(hit.target)
        (px4,) = psutil.Process(self.flight.pid(f"px4.{hit.vehicle}")).children()
        return px4.pid

    def _fate(self, hit: Hit, seen: int) -> Fate | None:
        """Return what happened to the process; on the ground, wait for it before the next hit."""
        if self.sortie.where == "air" or hit.target in ("world", "copilot"):
            return None  # told at the end: the others shall be hit at the same time
        flight, name = self.flight, hit.target.replace("PX4 of ", "px4.")

        def news() -> Fate | None:
            return _fate_of(flight.events(name)[seen:])

        return eventually(news, 30, f"{hit.cell}: {hit.cell.fate}", flight.said)

    def _hit_land_all(self, number: int, hit: Hit) -> None:
        flight = self.flight
        first = flight.start_cli("land-all", "--run", str(flight.folder))
        self.others.append(first)
        assert first.stdout is not None
        first.stdout.readline()
        if self.sortie.where == "air":
            names = self.sortie.names
            eventually(
                lambda: all(flight.fact(f"{v}.mode") == "AUTO.LAND" for v in names),
                20,
                "all told to land",
                flight.said,
            )
        os.kill(first.pid, number)
        second = flight.cli("land-all", "--run", str(flight.folder))
        os.kill(first.pid, signal.SIGCONT)
        code = first.wait(60)
        assert number == signal.SIGKILL or code == 0, "the first one goes on where it was"
        self.fates[hit] = Fate.TWICE if second.returncode == 0 else None
        assert second.returncode == 0, second.stdout + second.stderr

    def _until_over(self, at: float) -> None:
        """Wait until every vehicle has reached an allowed end."""
        if self._is_hit("world"):
            return
        if self._is_hit("supervisor", "SIGSTOP") and self.sortie.where == "air":
            # 2 s more than the failsafes take: the vehicle still flies
            eventually(lambda: self.flight.truth().time_s >= at + 3.0, 30, "3 s without a supervisor")
            assert self.flight.heights().min() > 0.5, self.flight.heights()
            return
        limit_s = 90.0
        eventually(
            lambda: all(map(self._is_over, self.sortie.names)), limit_s, f"{self.expected}", self._tell
        )

    def _is_over(self, name: str) -> bool:
        expected = self.expected[name]
        if expected & {End.FALLS, End.GONE}:
            return True
        flight = self.flight
        down = flight.heights()[self.sortie.names.index(name)] < STANDS_M
        in_vain = self.sortie.where == "ground" and self._is_hit("land-all")
        waits = End.FLIES in expected or in_vain
        return bool(down) and not (waits and _runs(self.programs[name]))

    def _tell(self) -> str:
        heights = [f"{h:.2f}" for h in self.flight.heights()]
        return f"heights {heights}\n{self.flight.said()}"

    def _end(self) -> int | None:
        """End the flight and return the exit code of `arena up`, None when it was killed; check that nothing is left."""
        flight = self.flight
        if self._is_hit("supervisor", "SIGKILL"):
            flight.wait()
            eventually(lambda: not flight.processes(), 70, "the end of every process", flight.processes)
            assert flight.cli("down").returncode == 0
        elif self._is_hit("supervisor", "SIGSTOP"):
            told = flight.cli("down")
            assert told.returncode == 0 and "does not reply" in told.stdout, told.stdout + told.stderr
        elif not (self._is_hit("world") or self._is_hit("copilot")):
            flight.signal(signal.SIGTERM)
        code = flight.wait(90)
        for hit in self.sortie.hits:
            if self.fates.get(hit) is None:
                seen = flight.events(hit.target.replace("PX4 of ", "px4."))
                ended, lost = _fate_of(seen), hit.target in ("world", "copilot")
                self.fates[hit] = Fate.LOST if lost and ended is Fate.ENDED else ended
        flight.assert_nothing_left()
        return code if code >= 0 else None

    def _is_hit(self, target: str, number: Signal | None = None) -> bool:
        return any(h.target == target and number in (None, h.cell.signal) for h in self.sortie.hits)

    # -- reading the records

    def _track(self, name: str, at: float) -> Track:
        flight, log = self.flight, self.flight.log(f"program.{name}")
        if self._is_hit("world"):
            return Track(end=End.GONE)
        rows = _rows(flight, name)
        time_s, p_n, v_d = rows[:, 0], rows[:, 1:4], rows[:, 4]
        height = p_n[0, 2] - p_n[:, 2]
        if height.max() < 0.1:
            return Track(end=End.STAYS)
        verdict = self._verdict(name)
        crashed = str(verdict.get("crashed", ""))
        # a program that runs to its end lands by itself: this landing does not count as an effect of the signal
        landed = int(np.flatnonzero(height > STANDS_M)[-1])
        hit = int(np.searchsorted(time_s, at)) if self.sortie.where == "air" else int(np.argmax(height > 0.5))
        sank = np.flatnonzero(v_d[hit:] > _SINKING_M_S)
        end = _end_of(log, bool(crashed))
        return Track(
            end=end,
            sank_s=float(time_s[hit + sank[0]] - at) if len(sank) and end is not End.FLIES else None,
            touchdown_m_s=float(verdict.get("touchdown_m_s") or v_d[max(0, landed - 2) : landed + 1].max()),
            drift_m=float(np.linalg.norm(p_n[-1, :2] - p_n[hit, :2])),
            crashed=crashed,
        )

    def _verdict(self, name: str) -> dict[str, Any]:
        """Return the world's crash report of a vehicle, if a supervisor was left to record it."""
        return self.flight.verdict(name) if (self.flight.folder / "outcome.json").exists() else {}


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _end_of(log: str, crashed: bool) -> End:
    """Return the end of a vehicle by the last line of its program's log."""
    if crashed:
        return End.FALLS
    if "landed as planned" in log:
        return End.FLIES
    if "blind land" in log:
        return End.BLIND
    told = "left OFFBOARD and is now in AUTO.LAND" in log and "Failsafe" not in log
    return End.COMMANDED if told else End.LANDS


def _fate_of(events: list[dict[str, str]]) -> Fate | None:
    """Return what happened to a process, by its events since it was ready."""
    reasons = [e.get("reason", "") for e in events]
    told = [e.get("to", "") for e in events]
    if "BACKOFF" in told and "READY" in told[told.index("BACKOFF") :]:
        stopped = any(r.startswith("paused for ") for r in reasons)
        return Fate.KILLED if stopped else Fate.AGAIN
    first = next((e for e in events if e.get("to") in ("EXITED", "FATAL")), None)
    if any("the arena does not kill it" in e.get("event", "") for e in events):
        return Fate.ALONE
    return Fate.ENDED if first is not None else None


def _rows(flight: Flight, name: str) -> NDArray[np.float64]:
    """Return the truth in the vehicle's log: time, position [NED], speed down, (n, 5). Incomplete rows are skipped."""
    names = ("time.seconds", "truth.pos.north", "truth.pos.east", "truth.pos.down", "truth.vel.down")
    found = []
    for row in flight.rows(name):
        try:
            found.append([float(row[key]) for key in names])
        except (TypeError, ValueError):
            continue
    return np.array(found)


def _yaml(sortie: Sortie, hangar: Hangar, go: Path, first_id: int) -> Path:
    program = f"{{path: '{PROGRAMS / 'wait_and_fly.py'}', args: ['{go}', '{sortie.stay_s:g}']}}"
    sleeps = "{argv: [sleep, '1000']}"
    lines = [
        "name: processes",
        f"address: {hangar.address}",
        "world: {size: [14, 6, 3]}",
        "sim: {processes: many}",
        f"tools: {{one: {sleeps}, two: {sleeps}}}",
        f"defaults: {{program: {program}}}",
        *sortie.more.splitlines(),
        "vehicles:",
    ]
    for i, name in enumerate(sortie.names):
        north = 2.0 * i - len(sortie.names) + 1
        pilot = "px4" if name in sortie.px4 else "builtin"
        lines.append(
            f"  {name}: {{id: {first_id + i}, autopilot: {pilot}, start: {{position: [{north:g}, 0, 0]}}}}"
        )
    file = hangar.folder / "processes.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


# -- judging -------------------------------------------------------------------------------------------------------------------


def problems(flown: Flown, hit: Hit) -> list[str]:
    """Return the differences between an observed result and its cell; empty if there are none."""
    sortie, cell = flown.sortie, hit.cell
    found = (
        []
        if flown.fates[hit] in (cell.fate, None)
        else [f"the process: {flown.fates[hit]}, expected {cell.fate}"]
    )
    expected, late = sortie.expected(), False
    for name, track in flown.tracks.items():
        found += (
            [f"{name} {track.end}, expected {' or '.join(expected[name])}"]
            if track.end not in expected[name]
            else []
        )
        late = late or track.end in {h.cell.else_ for h in sortie.hits}
        if track.touchdown_m_s is not None and End.FALLS not in expected[name]:
            found += [f"{name} crashed: {track.crashed}"] if track.crashed else []
            found += (
                [f"{name} touched down at {track.touchdown_m_s:.2f} m/s"]
                if track.touchdown_m_s > TOUCHDOWN_M_S
                else []
            )
            found += (
                [f"{name} drifted {track.drift_m:.2f} m"]
                if track.drift_m is not None and track.drift_m > DRIFT_M
                else []
            )
    if flown.code != sortie.codes and not late:
        found.append(f"arena up: exit {flown.code}, expected {sortie.codes}")
    return found


class Sorties:
    """Flies each sortie once and caches the result for all its cells."""

    def __init__(self, hangar_of: Callable[[], Hangar]) -> None:
        self._hangar_of = hangar_of
        self._flown: dict[tuple[str, bool], Flown | Exception] = {}

    def flown(self, sortie: Sortie, *, real: bool = False) -> Flown:
        """Return the result of a sortie. real: fly the real PX4 instead of its stand-in. Raises AssertionError."""
        key = sortie.name, real
        if key not in self._flown:
            self._flown[key] = self._fly(sortie, real)
        found = self._flown[key]
        if isinstance(found, Exception):
            raise found
        return found

    def _fly(self, sortie: Sortie, real: bool) -> Flown | Exception:
        hangar = self._hangar_of()
        try:
            # PX4 binds its ports on every address, so use ids that other arenas rarely have
            return fly(
                sortie,
                hangar,
                *(() if real else ("--set", "px4.home=stand-in")),
                first_id=120 + os.getpid() % 60,
            )
        except (AssertionError, OSError, ValueError, KeyError) as error:
            return AssertionError(f"{sortie.name}: {type(error).__name__}: {error}")
        finally:
            hangar.close()

    def problems(self, sortie: Sortie, hit: Hit, *, real: bool = False) -> list[str]:
        """Return how the cell differs from the table."""
        return problems(self.flown(sortie, real=real), hit)
