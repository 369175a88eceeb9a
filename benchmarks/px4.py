"""Benchmark of PX4 in the arena, its speed and number: `python benchmarks/px4.py alone | program | hover`.

alone     only the world and one PX4 at speed max: real-time factor, microseconds per step of each
program   `arena up` with one PX4 and the first example's program at speed max: real-time factor from arming to disarming
hover     N PX4 hover at 1.5 m in real time, with forwarders, router and recorder: real-time factor and CPU

PX4 is found as the package finds it (PX4_HOME, PATH); `--stand-in` flies the built-in autopilot behind the same link instead.
Wall-clock figures mean something on a quiet machine only: the load before each run is printed with it.
"""

from __future__ import annotations

import argparse
import bisect
import contextlib
import json
import mmap
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from arena.plan import make_plan
from arena.schema import load_arena
from arena.schema.px4 import STAND_IN, WAYS, find_px4

HERE = Path(__file__).parent
EXAMPLE = HERE.parent / "examples" / "01_two_quads" / "position_setpoints.py"
HOVER = HERE / "hover.py"
SETTLE_S = 5.0  # simulated, before the measurement: start-up of PX4 and its estimator
CLIMB_S, HOLD_S = (
    9.0,
    20.0,
)  # after the last has armed: when its program has ended and it holds, and for how long it is watched
START_S = 25.0  # wall time from `arena up` to the last arming, at most
LOST_RTF = 0.98
TICKS = os.sysconf("SC_CLK_TCK")
COUNTS = (1, 2, 5, 10, 12, 15, 20)
KINDS = ("world", "px4", "mocap", "forward", "router", "recorder", "program", "arena")


def arena_of(count: int, folder: Path, program: Path, given: argparse.Namespace) -> Path:
    """Write an arena with `count` vehicles in two rows, 2.5 m apart, and return its file."""
    rows = -(-count // 2)
    home = STAND_IN if given.stand_in else None
    lines = [
        f"address: {given.address}",
        f"world: {{size: [{3 * rows + 6}, 10, 4]}}",
        *([f"px4: {{home: {home}}}"] if home else []),
        # a vehicle whose program ends holds its position
        f"defaults: {{profile: iris, autopilot: px4, program: {program}, params: {{COM_OBL_RC_ACT: 5}}}}",
        "vehicles:",
    ]
    for i in range(count):
        north, east = 2.5 * (i // 2 - (rows - 1) / 2), 3.0 * (i % 2) - 1.5
        lines.append(f"  uav{i + 1}: {{id: {given.first_id + i}, start: {{position: [{north}, {east}, 0]}}}}")
    path = folder / "arena.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def cpu_s(*roots: int) -> list[float]:
    """Return the CPU time of each process and its descendants [s], in one pass over /proc to cost little CPU itself."""
    parents, own = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(") ")[2].split()
            pid = int(stat.parent.name)
            parents[pid], own[pid] = int(fields[1]), (int(fields[11]) + int(fields[12])) / TICKS
    totals = dict.fromkeys(roots, 0.0)
    for pid, used in own.items():
        at = pid
        while at and at not in totals:
            at = parents.get(at, 0)
        if at:
            totals[at] += used
    return [totals[root] for root in roots]


class Time:
    """Simulation time, read from the world's shared page."""

    def __init__(self, stem: Path) -> None:
        with Path(f"{stem}.page").open("rb") as file:
            self._page = memoryview(mmap.mmap(file.fileno(), 64, prot=mmap.PROT_READ)).cast("d")

    def now(self) -> float:
        return self._page[0]


# -- the world and one PX4 --------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def rooms(folder: Path, given: argparse.Namespace) -> Iterator[dict[str, int]]:
    """Start world and PX4 without a supervisor, from the plan's slices; yield process name -> pid."""
    plan = make_plan(load_arena(arena_of(1, folder, HOVER, given), ["sim.speed=max"]))
    children = {}
    try:
        for name, module in (("world", "arena.sim"), ("px4.uav1", "arena.px4")):
            slice_ = next(s for s in plan.slices.values() if s["name"] == name)
            text = json.dumps(
                slice_ | {"expected": []}
            )  # no program is started, so the world must not wait for one
            file = folder / f"{name}.json"
            file.write_text(text.replace("{run}", str(folder)).replace("{rt}", str(folder)))
            log = (folder / f"{name}.log").open("wb")
            children[name] = subprocess.Popen(
                [sys.executable, "-m", module, str(file)], stdout=log, stderr=log
            )
            deadline = time.monotonic() + 10.0
            while name == "world" and not (folder / "clock.sock").exists() and time.monotonic() < deadline:
                time.sleep(0.02)
        yield {name: child.pid for name, child in children.items()}
    finally:
        for child in reversed(list(children.values())):
            child.terminate()
            child.wait(10.0)


def alone(given: argparse.Namespace) -> int:
    """Print the real-time factor and CPU over `seconds` of wall time, after PX4 has been in step for a while."""
    factors = []
    print("real-time factor |  us a step: wall   world     px4 | world cpu %  px4 cpu % |  load")
    for _ in range(given.repeat):
        with tempfile.TemporaryDirectory(prefix="b-") as name:
            load, folder = os.getloadavg()[0], Path(name)
            with rooms(folder, given) as pids:
                clock = Time(folder / "clock")
                deadline = time.monotonic() + 30.0
                while (
                    not (folder / "px4.uav1.log").read_bytes().count(b"Startup script returned successfully")
                ):
                    if time.monotonic() > deadline:
                        raise SystemExit((folder / "px4.uav1.log").read_text(errors="replace"))
                    time.sleep(0.05)
                ready = clock.now()
                while clock.now() < ready + SETTLE_S:
                    time.sleep(0.01)
                sim, wall, used = (
                    clock.now(),
                    time.monotonic(),
                    dict(zip(pids, cpu_s(*pids.values()), strict=True)),
                )
                time.sleep(given.seconds)
                sim, wall = clock.now() - sim, time.monotonic() - wall
                used = {n: then - used[n] for n, then in zip(pids, cpu_s(*pids.values()), strict=True)}
        steps = sim * 250.0
        factors.append(sim / wall)
        print(
            f"{sim / wall:16.2f} | {1e6 * wall / steps:15.1f} {1e6 * used['world'] / steps:7.1f} "
            f"{1e6 * used['px4.uav1'] / steps:7.1f} | {100 * used['world'] / wall:11.1f} {100 * used['px4.uav1'] / wall:10.1f} "
            f"| {load:5.2f}",
            flush=True,
        )
    print(f"median {statistics.median(factors):.2f}")
    return 0


# -- whole arenas -------------------------------------------------------------------------------------------------------------


@dataclass(kw_only=True)
class Watched:
    """Measurements of one `arena up`.

    times: (wall, simulated) [s]
    cpu: (simulated, {process: CPU}) [s]
    """

    times: list[tuple[float, float]] = field(default_factory=list)
    cpu: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    exit_code: int = 0
    said: str = ""
    summary: dict[str, Any] = field(default_factory=dict)

    def wall(self, sim: float) -> float:
        """Return the wall time at a simulation time [s]."""
        i = min(bisect.bisect([s for _, s in self.times], sim), len(self.times) - 1)
        (w0, s0), (w1, s1) = self.times[max(i - 1, 0)], self.times[i]
        return w0 if s1 <= s0 else w0 + (w1 - w0) * (sim - s0) / (s1 - s0)

    def factors(self, begin: float, end: float) -> list[float]:
        """Return the real-time factor of each second of wall time between two simulation times [s]."""
        w, last, found = self.wall(begin), self.wall(end), []
        at = [t for t, _ in self.times]
        while w + 1.0 <= last:
            i, j = bisect.bisect(at, w), bisect.bisect(at, w + 1.0)
            (w0, s0), (w1, s1) = self.times[i], self.times[min(j, len(at) - 1)]
            if w1 > w0:
                found.append((s1 - s0) / (w1 - w0))
            w += 1.0
        return found

    def used(self, begin: float, end: float) -> dict[str, float]:
        """Return the cores used by each kind of process between two simulation times."""
        inside = [row for row in self.cpu if begin <= row[0] <= end]
        (s0, first), (s1, _) = inside[0], inside[-1]
        wall = self.wall(s1) - self.wall(s0)
        last = {
            name: used for _, row in inside for name, used in row.items()
        }  # an ended process keeps its last figure
        found = dict.fromkeys(KINDS, 0.0)
        for name, used in last.items():
            kind = name.split(".")[0]
            found[kind] = found.get(kind, 0.0) + (used - first.get(name, 0.0)) / wall
        return found

    def armed(self) -> list[tuple[float, float]]:
        """Return each vehicle's times of arming and disarming, simulated [s]."""
        spans = []
        for vehicle in self.summary["vehicles"].values():
            stamps = [m["t_s"] for m in vehicle["modes"] if m["armed"]]
            after = [
                m["t_s"] for m in vehicle["modes"] if stamps and not m["armed"] and m["t_s"] > stamps[-1]
            ]
            if stamps:
                spans.append((stamps[0], after[0] if after else self.times[-1][1]))
        return spans


def fly(count: int, program: Path, given: argparse.Namespace, speed: str, *ends: str) -> Watched:
    """Run one `arena up` and measure it. ends: options that end the run."""
    seen = Watched()
    with tempfile.TemporaryDirectory(prefix="b-") as name:
        folder = Path(name)
        path = arena_of(count, folder, program, given)
        argv = [sys.executable, "-m", "arena.cli", "up", str(path), "--headless", "--speed", speed, *ends]
        with (folder / "out").open("w") as out:
            child = subprocess.Popen(argv, stdout=out, stderr=out)
            try:
                watch(child, folder, seen)
            finally:
                child.terminate()
                child.wait(60.0)
        seen.exit_code, seen.said = child.returncode, (folder / "out").read_text()
        for file in folder.glob("runs/*/summary.json"):
            seen.summary = json.loads(file.read_text())
    if not seen.summary:
        raise SystemExit(seen.said)
    return seen


def watch(child: subprocess.Popen[bytes], folder: Path, seen: Watched) -> None:
    clock, next_cpu, supervisor = None, 0.0, child.pid
    while child.poll() is None:
        time.sleep(0.05)
        states = (
            list(folder.glob("runs/*/state.json")) if clock is None or time.monotonic() >= next_cpu else []
        )
        for file in states:
            with contextlib.suppress(OSError, ValueError):
                state = json.loads(file.read_text())
                if clock is None:
                    clock = Time(Path(state["rt"]) / "clock")
                pids = {n: m["pid"] for n, m in state["processes"].items()}
                used = dict(zip(pids, cpu_s(*pids.values()), strict=True))
                seen.cpu.append((clock.now(), used | {"arena": own_cpu_s(supervisor)}))
                next_cpu = time.monotonic() + 1.0
        if clock is not None:
            seen.times.append((time.monotonic(), clock.now()))


def own_cpu_s(pid: int) -> float:
    with contextlib.suppress(psutil.Error):
        times = psutil.Process(pid).cpu_times()
        return times.user + times.system
    return 0.0


def program(given: argparse.Namespace) -> int:
    """Print the real-time factor from arming to disarming, and the cores that each process used."""
    factors = []
    kinds = " ".join(f"{k:>8}" for k in KINDS)
    print(f"exit | factor armed..disarmed  worst second | cores: {kinds}   total | worst end m |  load")
    for _ in range(given.repeat):
        load = os.getloadavg()[0]
        seen = fly(1, EXAMPLE, given, "max", "--until-done", "--time-limit", "180")
        if seen.exit_code or not seen.armed():
            print(f"{seen.exit_code:4} | the flight failed; the load was {load:.2f}", flush=True)
            continue
        begin, end = seen.armed()[0]
        factors.append((end - begin) / (seen.wall(end) - seen.wall(begin)))
        used = seen.used(begin, end)
        cells = " ".join(f"{used[k]:8.2f}" for k in KINDS)
        worst = min(seen.factors(begin, end), default=0.0)
        total, off = (
            sum(used.values()),
            max(v["setpoints"]["worst_m"] for v in seen.summary["vehicles"].values()),
        )
        print(
            f"{seen.exit_code:4} | {factors[-1]:22.2f} {worst:13.2f} |        {cells} {total:7.2f} | {off:11.3f}",
            end="",
        )
        print(f" | {load:5.2f}", flush=True)
    print(f"median {statistics.median(factors):.2f}" if factors else "no flight was flown to its end")
    return 0 if factors else 1


def hover(given: argparse.Namespace) -> int:
    """Increase the number of vehicles until the real-time factor is too low; print the results."""
    went = 0
    heads = "vehicles exit | rtf min  median  p99 late ms | cores: " + " ".join(f"{k:>8}" for k in KINDS)
    print(heads + "   total | one px4 % | off 1.5 m m |  load")
    for count in given.vehicles:
        load = os.getloadavg()[0]
        seen = fly(count, HOVER, given, "1", "--time-limit", f"{START_S + CLIMB_S + HOLD_S:g}")
        spans = seen.armed()
        if len(spans) < count:
            print(
                f"{count:8} {seen.exit_code:4} | {len(spans)} of {count} armed; the load was {load:.2f}\n{seen.said[-4000:]}"
            )
            break
        begin, end = max(a for a, _ in spans) + CLIMB_S, min(a for a, _ in spans) + CLIMB_S + HOLD_S
        factors, used, summary = seen.factors(begin, end), seen.used(begin, end), seen.summary
        off = [abs(v["verdict"]["max_height_m"] - 1.5) for v in summary["vehicles"].values()]
        keeps = seen.exit_code == 0 and min(factors, default=0.0) >= LOST_RTF
        print(
            f"{count:8} {seen.exit_code:4} | {min(factors):7.3f} {statistics.median(factors):7.3f} "
            f"{summary['world']['lateness_p99_ms']:12.2f} |        "
            + " ".join(f"{used[k]:8.2f}" for k in KINDS)
            + f" {sum(used.values()):7.2f} | {100 * used['px4'] / count:9.2f} | {max(off):11.3f} | {load:5.2f}",
            flush=True,
        )
        went = count if keeps else went
        if not keeps:
            print(f"{count} do not keep real time (a second below {LOST_RTF:g}, or a flight that failed)")
            break
    print(f"{went} PX4 hover in real time on {os.cpu_count()} cores")
    return 0


def main() -> int:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("what", choices=("alone", "program", "hover"))
    options.add_argument("--stand-in", action="store_true", help="fly the stand-in instead of PX4")
    options.add_argument("--address", default="127.0.0.1", help="the arena's, a loopback address")
    options.add_argument(
        "--first-id", type=int, default=1, help="of the vehicles: PX4's ports follow from it"
    )
    options.add_argument("--repeat", type=int, default=3, help="runs of `alone` and `program`")
    options.add_argument("--seconds", type=float, default=5.0, help="of wall time that `alone` measures")
    options.add_argument("--vehicles", type=int, nargs="+", default=list(COUNTS), help="how many hover")
    given = options.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the finally blocks end what was started
    found = find_px4(STAND_IN if given.stand_in else None)
    if found is None:
        print("no PX4 was found: --stand-in measures without it, or\n  " + "\n  ".join(WAYS), file=sys.stderr)
        return 2
    name = "the stand-in, which is not PX4" if found.stand_in else f"PX4 {found.version}"
    print(f"{name}; {os.cpu_count()} cores")
    return {"alone": alone, "program": program, "hover": hover}[given.what](given)


if __name__ == "__main__":
    sys.exit(main())
