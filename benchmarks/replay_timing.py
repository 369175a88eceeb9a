"""`python benchmarks/replay_timing.py RUN`: times at which a client receives the messages of a replay at speed 1.

The client is a ground station. It compares the time of arrival of each datagram, stamped by the kernel, with the time at which the
datagram was recorded. Prints the differences from their median, and the load of the machine in the same time.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from arena.flight_log.recording import Recording
from arena.transport import enable_stamps, receive_stamped

GROUND_STATION = 14550


def recorded(run: Path) -> dict[int, list[tuple[float, bytes]]]:
    """Return MAVLink system id -> (time [s], datagram) of all datagrams from this vehicle."""
    record = Recording(run / "flight.mcap")
    return {v.id: [(d.time_s, d.data) for d in record.datagrams(v.name) if not d.up] for v in record.vehicles}


def receive(run: Path, options: list[str]) -> list[tuple[float, bytes]]:
    """Replay a run. Return (time of arrival [s], datagram) of all received datagrams."""
    station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
    station.bind(("0.0.0.0", GROUND_STATION))
    station.settimeout(0.2)
    enable_stamps(station)
    found: list[tuple[float, bytes]] = []
    with tempfile.TemporaryDirectory() as runs:
        command = [
            sys.executable,
            "-m",
            "arena",
            "replay",
            str(run),
            "--headless",
            "--no-report",
            "--runs",
            runs,
        ]
        replay = subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL)
        while replay.poll() is None:
            try:
                data, _, stamp_s = receive_stamped(station)
            except (TimeoutError, OSError):
                continue
            found.append((stamp_s or time.time(), data))
    station.close()
    return found


def errors_of(sent: list[tuple[float, bytes]], received: list[tuple[float, bytes]]) -> np.ndarray:
    """Return the difference between arrival and record of each datagram [s], minus the median difference."""
    places: dict[bytes, list[float]] = {}
    for time_s, data in reversed(sent):
        places.setdefault(data, []).append(time_s)
    late = np.array([at - places[data].pop() for at, data in received if places.get(data)])
    return late - np.median(late)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--times", type=int, default=1)
    given, options = parser.parse_known_args()
    sent = recorded(given.run)
    for _ in range(given.times):
        psutil.cpu_percent()
        received = receive(given.run, options)
        busy, (load, *_) = psutil.cpu_percent(), os.getloadavg()
        late = 1e3 * np.concatenate(
            [
                errors_of(own, [(at, d) for at, d in received if len(d) > 5 and d[5] == system])
                for system, own in sent.items()
            ]
        )
        p1, p50, p99 = np.percentile(late, [1, 50, 99])
        size = np.percentile(np.abs(late), [50, 99])
        print(
            f"{len(late)} of {sum(map(len, sent.values()))} datagrams; CPU {busy:.0f} % busy, load {load:.1f}"
        )
        print(f"  difference [ms]: p1 {p1:.2f}, p50 {p50:.2f}, p99 {p99:.2f}, max {late.max():.2f}", end="; ")
        print(f"magnitude p50 {size[0]:.2f}, p99 {size[1]:.2f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
