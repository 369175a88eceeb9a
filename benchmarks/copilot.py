"""Flights that end badly without a copilot, with one and without; and how far vehicles go on when it stops them.

    python benchmarks/copilot.py [--autopilot builtin|px4|both] [--case head-on|wall|stops|cost] [--runs 5] [--with-only]

head-on: two programs sent through each other's place at 1.5 m/s each.  wall: a program that flies into the wall at 3 m/s.
stops: 1, 2 and 3 m/s, steady and still speeding up, along north and obliquely: predicted and actual stopping distance.
cost: of 1, 10 and 50 vehicles, in one core's time, without the sockets.
Prints tables in Markdown. Exit code 1: a flight that crashed with a copilot or did not without, or a stop longer than predicted.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.copilot.copilot import Copilot
from arena.copilot.settings import Rules, Vehicle
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet.receiver import NatNetReceiver
from arena.schema.copilot import RULES
from arena.schema.copilot import Copilot as Section
from arena.wire.mavlink_codec import Codec

PROGRAM = Path(__file__).parents[1] / "examples" / "08_copilot" / "straight.py"
RADIUS_M = 0.275
"""Of the vehicle: without a geofence its centre stays so far from the walls."""
FIRST_ID = 65
"""PX4 binds its ports on every address: other arenas of this computer may fly theirs with the low ids."""
_NEEDS = re.compile(
    r"to stop from ([\d.]+) m/s it needs ([\d.]+) m and ([\d.]+) m in reserve, and the [\w ]+ is (-?[\d.]+) m away"
)


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What a flight left. crashed: the world's words, "" for none. places: name -> truth [m] [NED] (T, 3)."""

    code: int
    crashed: str
    events: tuple[str, ...]
    places: dict[str, NDArray[np.float64]]

    @property
    def closest_m(self) -> float:
        """Of the first two vehicles, at the same rows: the logs are written at the same instants."""
        a, b = list(self.places.values())[:2]
        n = min(len(a), len(b))
        return float(np.linalg.norm(a[:n] - b[:n], axis=1).min())


def fly(
    autopilot: str,
    size: tuple[float, float, float],
    vehicles: dict[str, tuple[float, float, str]],
    *,
    copilot: bool,
    address: str,
) -> Flown:
    """vehicles: name -> start north, east [m], arguments of the program."""
    lines = [f"address: {address}", f"world: {{size: {list(size)}}}", f"defaults: {{autopilot: {autopilot}}}"]
    lines += ["copilot: {}"] if copilot else []
    lines += ["vehicles:"]
    for k, (name, (north, east, words)) in enumerate(vehicles.items()):
        program = f"{{path: '{PROGRAM}', args: [{', '.join(repr(w) for w in words.split())}]}}"
        lines.append(
            f"  {name}: {{id: {FIRST_ID + k}, start: {{position: [{north}, {east}, 0]}}, program: {program}}}"
        )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arena.yaml"
        file.write_text("\n".join(lines) + "\n")
        up = [
            "up",
            str(file),
            "--headless",
            "--until-done",
            "--no-report",
            "--speed",
            "max",
            "--time-limit",
            "240",
        ]
        done = subprocess.run(
            [sys.executable, "-m", "arena.cli", *up],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "ARENA_RUNTIME_DIR": folder},
        )
        found = [run for run in (Path(folder) / "runs").glob("*") if (run / "outcome.json").exists()]
        if not found:
            raise SystemExit(done.stdout + done.stderr)
        return _read(found[0], list(vehicles))


def _read(run: Path, names: list[str]) -> Flown:
    outcome = json.loads((run / "outcome.json").read_text())
    verdicts = outcome["processes"]["world"]["stats"]["vehicles"]
    events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    said = tuple(str(e["event"]) for e in events if e["process"] == "copilot" and "event" in e)
    crashed = "; ".join(f"{n}: {verdicts[n]['crashed']}" for n in names if verdicts[n]["crashed"])
    return Flown(
        code=outcome["exit_code"], crashed=crashed, events=said, places={n: _truth(run, n) for n in names}
    )


def _truth(run: Path, name: str) -> NDArray[np.float64]:
    with (run / "csv" / f"{name}.csv").open() as file:
        rows = [
            [row[f"truth.pos.{axis}"] for axis in ("north", "east", "down")] for row in csv.DictReader(file)
        ]
    return np.array([[float(x) for x in row] for row in rows if all(row)])


def head_on(autopilot: str, *, copilot: bool, address: str) -> tuple[Flown, float]:
    """-> closest approach [m]."""
    vehicles = {"uav1": (-4.5, 0.0, "1.5 0 5.5"), "uav2": (4.5, 0.0, "-1.5 0 5.5")}
    flown = fly(autopilot, (24, 8, 4), vehicles, copilot=copilot, address=address)
    return flown, flown.closest_m


def wall(
    autopilot: str,
    *,
    copilot: bool,
    address: str,
    speed: float = 3.0,
    run_m: float = 10.0,
    oblique: bool = False,
) -> tuple[Flown, float]:
    """run_m: of its start from the wall; oblique: into a corner. -> the least distance of its centre from a wall [m]."""
    half, start = 7.0, 7.0 - run_m
    velocity = f"{speed * math.sqrt(0.5):.4f} {speed * math.sqrt(0.5):.4f}" if oblique else f"{speed} 0"
    vehicles = {"uav1": (start, start if oblique else 0.0, f"{velocity} 20")}
    flown = fly(
        autopilot, (2 * half, 2 * half if oblique else 6.0, 4), vehicles, copilot=copilot, address=address
    )
    place = flown.places["uav1"]
    return flown, half - float(place[:, :2].max() if oblique else place[:, 0].max())


def crashes(autopilot: str, case: str, runs: int, *, with_only: bool, address: str) -> Iterator[bool]:
    flight = {"head-on": head_on, "wall": wall}[case]
    for copilot in (True,) if with_only else (False, True):
        nearest, bad, codes = [], 0, []
        for _ in range(runs):
            flown, least = flight(autopilot, copilot=copilot, address=address)
            nearest.append(least)
            bad += bool(flown.crashed)
            codes.append(flown.code)
            if bool(flown.crashed) is copilot:
                print(flown, file=sys.stderr)
        least_, most = min(nearest), max(nearest)
        print(
            f"| {case} | {autopilot} | {'yes' if copilot else 'no'} | {runs} | {bad} | {least_:.2f} to {most:.2f} |",
            flush=True,
        )
        yield bad == (0 if copilot else runs)


def predict_stops(autopilot: str, address: str) -> Iterator[bool]:
    for speed in (1.0, 2.0, 3.0):
        for words, run_m, oblique in (
            ("steady", 10.0, False),
            ("speeding up", 1.5 + 1.1 * speed, False),
            ("oblique", 9.0, True),
        ):
            flown, least = wall(
                autopilot, copilot=True, address=address, speed=speed, run_m=run_m, oblique=oblique
            )
            told = next((m for m in map(_NEEDS.search, flown.events) if m), None)
            if told is None:
                print(flown.events, file=sys.stderr)
                yield False
                continue
            at, needs, _, left = (float(x) for x in told.groups())
            fence = least - RADIUS_M  # what was left of the way to the fence
            way = left - fence
            print(
                f"| {autopilot} | {words} | {speed:g} | {at:.1f} | {needs:.2f} | {way:.2f} | {fence:.2f} |",
                flush=True,
            )
            yield way <= needs and not flown.crashed


def _distance_text(system: int) -> list[bytes]:
    """What a vehicle says in a fiftieth of a second: five frames in two datagrams, as the built-in autopilot's stream at most."""
    codec = Codec(system, 1)
    first = [
        mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, -1.0, 0.1, 0.2, 0.3),
        mavlink.MAVLink_attitude_quaternion_message(0, 1.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1),
    ]
    second = [
        mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3),
        mavlink.MAVLink_extended_sys_state_message(0, 2),
        mavlink.MAVLink_position_target_local_ned_message(0, 1, 0, 1.0, 2.0, -1.0, *[0.0] * 8),
    ]
    return [b"".join(codec.pack(m) for m in part) for part in (first, second)]


def cost(count: int, seconds: float = 4.0) -> bool:
    """Measure the copilot's CPU time per second with `count` vehicles: camera frames, telemetry and rule checks."""
    rows = [
        {
            "name": f"uav{i + 1}",
            "id": i + 1,
            "body": f"uav{i + 1}",
            "simulated": True,
            "poses": True,
            "tools": ["127.0.0.1", i],
            "panic": ["127.0.0.1", i],
            "fence": {"north": [-50, 50], "east": [-50, 50], "up": 5},
            "braking": {"accel": 3.0, "jerk": 4.0, "up": 3.0, "down": 4.0},
        }
        for i in range(count)
    ]
    section = Section.model_validate({"estimate": {"do": "none"}})  # what they say here is always the same
    each = {rule: getattr(section, rule).model_dump() for rule in RULES}
    rules = Rules.of({"rules": each, "at_most": "land", "escalate_after_s": 2.0, "latency_s": 0.01})
    core, spent = (
        Copilot(rules, [Vehicle.of(row) for row in rows], 0.0),
        dict.fromkeys(("poses", "telemetry", "rule checks"), 0.0),
    )
    receiver, version = NatNetReceiver([row["name"] for row in rows]), (3, 1, 0, 0)
    receiver.receive(
        natnet.encode_server_info(
            natnet.ServerInfo(
                name="m",
                app_version=version,
                version=(3, 1, 0, 0),
                clock_hz=1000,
                data_port=1511,
                group="239.255.42.99",
            )
        )
    )
    receiver.receive(natnet.encode_models([(row["id"], row["name"]) for row in rows], version))
    words = [_distance_text(row["id"]) for row in rows]
    place, speed = np.arange(count) % 10 * 2.0, 0.3
    for k in range(round(50 * seconds)):
        now = k / 50.0
        for j in range(4 if k % 5 < 3 else 3):
            north = place + speed * math.sin(now)
            bodies = tuple(
                natnet.Body(
                    streaming_id=i + 1,
                    position=(2.0 * (i // 10), float(north[i]), 1.0 + 1e-6 * (4 * k + j)),
                    quat_xyzw=(0.0, 0.0, 0.7071068, 0.7071068),
                    tracked=True,
                )
                for i in range(count)
            )
            data = natnet.encode_frame(
                natnet.Frame(
                    number=4 * k + j + 1, timestamp_s=now + j / 180.0, exposure_ticks=0, bodies=bodies
                ),
                version,
            )
            made = time.thread_time()
            frame = receiver.receive(data)
            core.on_frames([frame] if frame is not None else [], now)
            spent["poses"] += time.thread_time() - made
        began = time.thread_time()
        for i in range(count):
            for data in words[i]:
                core.on_datagram(i, data, now)
        spent["telemetry"] += time.thread_time() - began
        began = time.thread_time()
        core.step(now)
        spent["rule checks"] += time.thread_time() - began
    share = {what: 100.0 * s / seconds for what, s in spent.items()}
    print(
        f"| {count} | " + " | ".join(f"{x:.1f}" for x in share.values()) + f" | {sum(share.values()):.1f} |",
        flush=True,
    )
    return core.states.armed == [True] * count and bool(np.isfinite(core.tracks.seen_at).all())


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--autopilot", choices=("builtin", "px4", "both"), default="builtin")
    options.add_argument("--case", choices=("head-on", "wall", "stops", "cost"), action="append")
    options.add_argument("--runs", type=int, default=5)
    options.add_argument("--with-only", action="store_true", help="do not fly without a copilot")
    options.add_argument("--address", default="127.65.9.1")
    given = options.parse_args()
    pilots = ("builtin", "px4") if given.autopilot == "both" else (given.autopilot,)
    cases = given.case or ["head-on", "wall", "stops", "cost"]
    right: list[bool] = []
    for case in cases:
        if case == "cost":
            print(
                "| vehicles | poses % | telemetry % | rule checks % | total % of one core |\n| "
                + "--- | " * 5
            )
            right += [cost(count) for count in (1, 10, 50)]
            continue
        if case == "stops":
            print(
                "| autopilot | flight | commanded m/s | speed at hold m/s | predicted stop m | actual stop m | left to the fence m |\n| "
                + "--- | " * 7
            )
        else:
            print("| flight | autopilot | copilot | runs | crashed | closest m |\n| " + "--- | " * 6)
        for pilot in pilots:
            right += (
                predict_stops(pilot, given.address)
                if case == "stops"
                else crashes(pilot, case, given.runs, with_only=given.with_only, address=given.address)
            )
    return 0 if all(right) else 1


if __name__ == "__main__":
    sys.exit(main())
