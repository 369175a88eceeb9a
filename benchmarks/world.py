"""Benchmark of the world and its built-in autopilots: the time of one step, by the number of vehicles.

    python benchmarks/world.py [--counts 1 10 50 200] [--repeat 3] [--plot cost.png]

One step is a sensor period of 4 ms: two physics steps at 500 Hz, all sensors, truth and crash detection (world); then
estimators, control, failsafes and MAVLink both ways (autopilots). Each vehicle hovers in OFFBOARD on poses at 60 Hz and
setpoints at 30 Hz, and its telemetry is packed at PX4's rates. One process, one core, no sockets. Each figure is the
smallest mean over many rounds of 100 steps, by the wall clock: run it on a core with no other work. `x real time` is 4 ms
divided by their sum. `standing`: the world's step with every vehicle on the floor, where bullet solves contacts.
"""

from __future__ import annotations

import argparse
import gc
import math
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots
from arena.plan import make_plan
from arena.schema import load_arena
from arena.sim.world import World

STEP_US = 4000.0
POSES_EVERY, SETPOINTS_EVERY = 4, 8  # steps: 62.5 Hz, 31.25 Hz
HEIGHT_M = 1.5
ROUND = 100  # steps in a round; every frequent stream is sent in it
NAN21 = [math.nan] * 21
COVARIANCE = [1e-6 if k in (0, 6, 11, 15, 18, 20) else math.nan for k in range(21)]


def settings(count: int, folder: Path) -> dict[str, Any]:
    """Return the world's slice of an arena with `count` vehicles, two metres apart."""
    side = math.ceil(math.sqrt(count))
    lines = [
        f"world: {{size: [{2 * side + 6}, {2 * side + 6}, 6]}}",
        "defaults: {profile: iris, autopilot: builtin}",
        "vehicles:",
    ]
    for k in range(count):
        north, east = (2.0 * (each - (side - 1) / 2) for each in divmod(k, side))
        lines.append(f"  uav{k + 1}: {{start: {{position: [{north}, {east}, 0]}}}}")
    path = folder / f"{count}.yaml"
    path.write_text("\n".join(lines) + "\n")
    slice_: dict[str, Any] = make_plan(load_arena(path)).slices["world.json"]
    return slice_


class Fleet:
    """World and autopilots stepped in one process, as the process `world` steps them."""

    def __init__(self, slice_: dict[str, Any]) -> None:
        self.world = World(slice_)
        self.autopilots = Autopilots(slice_, self.world.period_s)
        self.count = len(slice_["vehicles"])
        self.ids = [v["id"] for v in slice_["vehicles"]]
        self.senders = [mavlink.MAVLink(None, srcSystem=i, srcComponent=191) for i in self.ids]
        self.start_p_n = self.world.truth().p_n.copy()
        self.motors: Any = np.zeros((self.count, 4))
        self.steps, self.spent = 0, {"world": 0.0, "autopilots": 0.0}

    def close(self) -> None:
        self.world.close()

    def step(self) -> None:
        messages = self._messages()  # not measured: it is the work of forwarders and programs
        began = time.perf_counter()
        sensors = self.world.sense()
        sensed = time.perf_counter()
        for i, link, data in messages:
            self.autopilots.receive(i, link, data)
        self.motors = self.autopilots.step(self.world.now, sensors)
        self.autopilots.transmit()
        flown = time.perf_counter()
        self.world.step(self.motors)
        self.world.live_truth()
        self.spent["world"] += sensed - began + time.perf_counter() - flown
        self.spent["autopilots"] += flown - sensed
        self.steps += 1

    def _messages(self) -> list[tuple[int, str, bytes]]:
        messages = []
        if self.steps % POSES_EVERY == 0:
            truth = self.world.truth()
            for i, sender in enumerate(self.senders):
                pose = mavlink.MAVLink_odometry_message(
                    0, 1, 12, *truth.p_n[i], truth.q_nb[i].tolist(), *NAN21[:6], COVARIANCE, NAN21, 0, 2, 0
                )
                messages.append((i, "vision", pose.pack(sender)))
        if self.steps % SETPOINTS_EVERY == 0:
            for i, sender in enumerate(self.senders):
                n, e, d = self.start_p_n[i]
                target = mavlink.MAVLink_set_position_target_local_ned_message(
                    0, self.ids[i], 1, 1, 0b100111111000, n, e, d - HEIGHT_M, 0, 0, 0, 0, 0, 0, 0, 0
                )
                messages.append((i, "router", target.pack(sender)))
        return messages

    def command(self, command: int, *values: float) -> None:
        for i, sender in enumerate(self.senders):
            message = mavlink.MAVLink_command_long_message(
                self.ids[i], 1, command, 0, *(*values, *[0.0] * 7)[:7]
            )
            self.autopilots.receive(i, "router", message.pack(sender))

    def take_off(self) -> None:
        """Fly every vehicle to its height in OFFBOARD. Raises SystemExit when one does not reach it."""
        for i, sender in enumerate(self.senders):
            origin = mavlink.MAVLink_set_gps_global_origin_message(
                self.ids[i], 387_000_000, -91_000_000, 100_000
            )
            self.autopilots.receive(i, "vision", origin.pack(sender))
        self.run(1000)  # estimators settle
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)
        self.run(10)
        self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self.run(1500)
        gc.collect()
        gc.freeze()
        gc.disable()  # the process `world` searches for garbage once a second
        if np.any(np.abs(self.start_p_n[:, 2] - HEIGHT_M - self.world.truth().p_n[:, 2]) > 0.15):
            raise SystemExit(
                f"of {self.count} vehicles, not every one hovers: {self.world.truth().p_n[:, 2]}"
            )

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.step()

    def costs(self, rounds: int) -> dict[str, float]:
        """Return the time of a step by part [us], from the round with the smallest sum."""
        seen: list[dict[str, float]] = []
        for _ in range(rounds):
            before = dict(self.spent)
            self.run(ROUND)
            seen.append({part: (self.spent[part] - was) / ROUND * 1e6 for part, was in before.items()})
        return min(seen, key=lambda each: sum(each.values()))


@dataclass(frozen=True, kw_only=True)
class Row:
    """Figures for one number of vehicles: times of a step [us]."""

    count: int
    world: float
    autopilots: float
    standing: float

    @property
    def whole(self) -> float:
        return self.world + self.autopilots


def measure(count: int, folder: Path, rounds: int) -> Row:
    fleet = Fleet(settings(count, folder))
    fleet.run(ROUND)
    standing = fleet.costs(rounds)["world"]
    fleet.take_off()
    flying = fleet.costs(rounds)
    fleet.close()
    return Row(count=count, world=flying["world"], autopilots=flying["autopilots"], standing=standing)


def table(rows: list[Row]) -> str:
    lines = [
        "| vehicles | world µs | autopilots µs | both µs | per vehicle µs | x real time | world, standing µs |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {r.count} | {r.world:.0f} | {r.autopilots:.0f} | {r.whole:.0f} | {r.whole / r.count:.1f} "
        f"| {STEP_US / r.whole:.1f} | {r.standing:.0f} |"
        for r in rows
    ]
    return "\n".join(lines)


def plot(rows: list[Row], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import FuncFormatter, LogLocator

    counts = [r.count for r in rows]
    figure, (cost, speed) = plt.subplots(1, 2, figsize=(9, 3.6), constrained_layout=True)
    for part, colour in (("autopilots", "tab:blue"), ("world", "tab:orange")):
        cost.plot(counts, [getattr(r, part) / r.count for r in rows], "o-", color=colour, label=part)
    cost.plot(counts, [r.whole / r.count for r in rows], "o-", color="black", label="both")
    cost.set(xscale="log", yscale="log", xlabel="vehicles", ylabel="per vehicle and step [µs]")
    cost.legend()
    speed.plot(counts, [STEP_US / r.whole for r in rows], "o-", color="black")
    speed.axhline(1.0, color="grey", linewidth=0.8)
    speed.annotate("real time", (counts[0], 1.0), textcoords="offset points", xytext=(0, 3), color="grey")
    speed.set(xscale="log", yscale="log", xlabel="vehicles", ylabel="times real time, on one core")
    for axes in (cost, speed):
        axes.set_xticks(counts, map(str, counts))
        axes.minorticks_off()
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main() -> None:

    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--counts", type=int, nargs="+", default=[1, 2, 5, 10, 20, 50, 100, 200])
    options.add_argument(
        "--repeat",
        type=int,
        default=3,
        metavar="ROUNDS",
        help="rounds per figure; the fastest counts",
    )
    options.add_argument("--plot", type=Path, metavar="FILE")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = [measure(count, Path(folder), given.repeat) for count in given.counts]
    print(table(rows))
    if given.plot:
        plot(rows, given.plot)


if __name__ == "__main__":
    main()
