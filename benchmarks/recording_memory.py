"""`python benchmarks/recording_memory.py [--vehicles 10] [--minutes 60]`: memory of the recorder in a long flight.

The core of the recorder gets the streams of many vehicles in simulated time, as fast as possible: per vehicle 125 datagrams a second
from the vehicle, 50 to it, 30 true states, and 100 frames of motion capture for all. Prints resident memory, and counts the messages in
the file with the `mcap` library. `--raw` leaves the channels for viewers out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from mcap.reader import make_reader
from recording import POOL, setpoint, telemetry

from arena.mocap.client import CapturedFrame, Pose
from arena.process_context import ProcessContext
from arena.recorder.channel_sets import make_channels
from arena.recorder.channels import RawChannels
from arena.recorder.flight_recorder import FlightRecorder
from arena.wire.truth_page import Truth

STEP_MS = 2
SHAPE = {"rotors_m": [[0.1, 0.1, 0.0]], "rotor_radius_m": 0.1, "radius_m": 0.2, "height_m": 0.1}


def feed(recorder: FlightRecorder, vehicles: int, minutes: float) -> Iterator[float]:
    """Give the recorder all messages of a flight. Yield the simulated time [s] once per simulated minute."""
    names = [f"uav{k + 1}" for k in range(vehicles)]
    down = [[telemetry(k + 1, i) for i in range(POOL)] for k in range(vehicles)]
    up = [[setpoint(k + 1, i) for i in range(POOL)] for k in range(vehicles)]
    poses = tuple(Pose(name, (1.0, 2.0, -1.0), (1.0, 0.0, 0.0, 0.0)) for name in names)
    for step in range(round(minutes * 60_000 / STEP_MS)):
        ms = step * STEP_MS
        now_s = 1e-3 * ms
        for k in range(vehicles):
            if (ms + 2 * k) % 8 == 0:
                recorder.on_datagrams([(names[k], False, down[k][(ms // 8) % POOL], now_s)])
            if (ms + 2 * k) % 20 == 0:
                recorder.on_datagrams([(names[k], True, up[k][(ms // 20) % POOL], now_s)])
        if ms % 10 == 0:
            frame = CapturedFrame(number=ms // 10, time_s=now_s - 0.004, poses=poses, untracked=())
            recorder.on_frame(frame, True, now_s)
        if ms % 34 == 0:
            recorder.on_truth(truth(vehicles, now_s), now_s)
        if ms % 100 == 0:
            recorder.tick(now_s, now_s)
            wait_for_disk(recorder)
        if ms % 60_000 == 0:
            yield now_s
    yield 60.0 * minutes


def truth(vehicles: int, time_s: float) -> Truth:
    """Return a true state of each vehicle."""
    rows = np.full((vehicles, 3), 0.1 * time_s)
    q_nb = np.tile([1.0, 0.0, 0.0, 0.0], (vehicles, 1))
    return Truth(
        time_s=time_s,
        p_n=rows,
        q_nb=q_nb,
        v_n=rows,
        omega_b=rows,
        accel_b=rows,
        motors=np.zeros((vehicles, 8)),
    )


def wait_for_disk(recorder: FlightRecorder) -> None:
    """Wait until the disk has everything: simulated time must not advance faster than the disk writes."""
    while recorder._file.busy:
        time.sleep(0.0005)


def settings(vehicles: int, folder: Path) -> dict[str, Any]:
    """Return the configuration of the recorder."""
    found = [
        {
            "name": f"uav{k + 1}",
            "id": k + 1,
            "body": f"uav{k + 1}",
            "index": k,
            "autopilot": "builtin",
            "profile": "iris",
            "shape": SHAPE,
        }
        for k in range(vehicles)
    ]
    return {
        "name": "recorder",
        "arena": "benchmark",
        "size_m": [20, 20, 5],
        "vehicles": found,
        "clock": "simulation",
        "folder": str(folder),
        "fence": None,
        "foxglove": None,
    }


def run(vehicles: int, minutes: float, raw: bool) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder, process = Path(temporary), psutil.Process()
        configured = settings(vehicles, folder)
        make = (lambda _, recorded, channel: [RawChannels(recorded, channel)]) if raw else make_channels
        recorder = FlightRecorder(ProcessContext("recorder", configured, None), 0.0, make, own_events=False)
        sent, printed_s, at_s = round(60.0 * minutes * vehicles * 175), -1.0, 0.0
        began, cpu = time.monotonic(), process.cpu_times()
        for at_s in feed(recorder, vehicles, minutes):
            if at_s >= printed_s + 300.0 or at_s in (0.0, 60.0, 60.0 * minutes):
                printed_s = at_s
                print(f"  {at_s / 60:4.0f} min: {process.memory_info().rss / 1e6:.0f} MB", flush=True)
        recorder.close(at_s)
        used = process.cpu_times()
        peak = int(
            next(x for x in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in x).split()[1]
        )
        print(f"  after the end: {process.memory_info().rss / 1e6:.0f} MB, at most {1.024e-3 * peak:.0f} MB")
        cpu_s = used.user + used.system - cpu.user - cpu.system
        print(
            f"  {sent} datagrams, {1e6 * cpu_s / sent:.1f} us of CPU time each ({time.monotonic() - began:.0f} s)"
        )
        path = folder / "flight.mcap"
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None and summary.statistics is not None
        counts = {summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()}
        kept = sum(n for topic, n in counts.items() if "/mavlink/" in topic)
        print(
            f"  in the file: {kept} datagrams, {sum(counts.values())} messages of {len(counts)} channels in",
            end=" ",
        )
        print(f"{len(summary.chunk_indexes)} chunks, {path.stat().st_size / 1e6:.0f} MB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--raw", action="store_true")
    given = parser.parse_args()
    print(f"{given.vehicles} vehicles, {given.minutes:g} minutes of simulated time")
    run(given.vehicles, given.minutes, given.raw)
    return 0


if __name__ == "__main__":
    sys.exit(main())
