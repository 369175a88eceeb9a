"""`python benchmarks/recording.py [--vehicles 50] [--seconds 30]`: full streams of many vehicles, all recorded?

A sender replaces the router: per vehicle 125 datagrams a second from the vehicle with the messages of the built-in autopilot
(5 frames each, 250 bytes), and 50 a second to the vehicle. Counts what was sent, and compares it with flight.mcap, datagram for
datagram. Prints CPU time and memory of the recorder; `--raw` leaves the channels for viewers out.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from itertools import islice
from pathlib import Path

import psutil
from pymavlink.dialects.v20 import common as mavlink

from arena.flight_log.recording import Recording
from arena.process_context import SOCKET_VARIABLE

HOST = "127.54.210.1"
TICK_S, DOWN_TICKS, UP_TICKS = 0.002, 4, 10  # a datagram down each 8 ms, up each 20 ms
POOL = 500  # different datagrams per vehicle and direction
RAW = """
from arena.recorder.__main__ import main
from arena.recorder.channels import RawChannels
from arena.recorder.flight_recorder import FlightRecorder
FlightRecorder.__init__.__defaults__ = (lambda settings, vehicles, channel: [RawChannels(vehicles, channel)],)
raise SystemExit(main())
"""


def telemetry(system: int, number: int) -> bytes:
    """Return a datagram of an autopilot. number: its place in the stream."""
    out, ms = mavlink.MAVLink(None, srcSystem=system, srcComponent=1), 8 * number
    a = 0.001 * number
    messages = (
        mavlink.MAVLink_attitude_quaternion_message(ms, 1.0 - a * a, a, -a, a / 3, a, a / 7, a / 9),
        mavlink.MAVLink_local_position_ned_message(ms, a, 2 * a, -a / 3, a / 5, -a / 11, a / 13),
        mavlink.MAVLink_highres_imu_message(
            ms * 1000, a, -a, -9.8 + a, a / 3, a / 5, a / 7, 0.2, 0.1, 0.4, 1013.0, 0, a, 21.0, 0x3F
        ),
        mavlink.MAVLink_attitude_target_message(ms, 0, [1.0, a, -a, 0.0], a, a / 3, 0.0, 0.5 + a / 9),
        mavlink.MAVLink_heartbeat_message(2, 12, 129, 6 << 16, 4, 3)
        if number % 125 == 0
        else mavlink.MAVLink_servo_output_raw_message(
            ms * 1000, 0, *(1500 + number % 200 + k for k in range(8)), *[0] * 8
        ),
    )
    return b"".join(m.pack(out) for m in messages)


def setpoint(system: int, number: int) -> bytes:
    out, a = mavlink.MAVLink(None, srcSystem=system, srcComponent=191), 0.001 * number
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        20 * number, system, 1, 1, 0, a, -a, -1.5, a, a, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0
    )
    return bytes(message.pack(out))


def udp(host: str = HOST) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((host, 0))
    return opened


class Sender:
    """Sockets of the router for one vehicle, and the numbers of datagrams that were sent."""

    def __init__(self, system: int) -> None:
        self.name, self.id, self.sent = f"uav{system}", system, {False: 0, True: 0}
        self.sockets = {False: udp(), True: udp()}
        self.pools = {
            False: [telemetry(system, i) for i in range(POOL)],
            True: [setpoint(system, i) for i in range(POOL)],
        }

    def send(self, up: bool, to: tuple[str, int]) -> None:
        self.sockets[up].sendto(self.pools[up][self.sent[up] % POOL], to)
        self.sent[up] += 1

    def compare(self, record: Recording) -> tuple[int, int]:
        """Return the numbers of datagrams that are not in the record, and of those that are not at their place or were not sent."""
        places = {up: {data: place for place, data in enumerate(pool)} for up, pool in self.pools.items()}
        found, last, wrong = {False: 0, True: 0}, {False: -1, True: -1}, 0
        for _, up, data in record.datagrams(self.name):
            place = places[up].get(data, -1)
            ahead = (place - last[up] - 1) % POOL  # datagrams that are missing here
            wrong += place < 0 or ahead > POOL // 2
            found[up] += 1
            last[up] = place
        return sum(self.sent[up] - found[up] for up in found), wrong


def run(count: int, seconds: float, raw: bool, keep: Path | None) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        with udp() as probe:
            to = probe.getsockname()
        senders = [Sender(k + 1) for k in range(count)]
        shape = {
            "rotors_m": [[0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]],
            "rotor_radius_m": 0.1,
            "radius_m": 0.2,
            "height_m": 0.1,
        }
        vehicles = [
            {"name": s.name, "id": s.id, "body": s.name, "index": None, "autopilot": "px4", "profile": "iris"}
            | {
                "serve": s.sockets[False].getsockname(),
                "tools": s.sockets[True].getsockname(),
                "shape": shape,
            }
            for s in senders
        ]
        settings = {"name": "recorder", "arena": "benchmark", "size_m": [20, 20, 5], "vehicles": vehicles}
        settings |= {"listen": to, "captures": [], "truth": None, "rate_hz": 30.0, "clock": None}
        settings |= {"folder": str(folder), "fence": None, "foxglove": None}
        (folder / "recorder.json").write_text(json.dumps(settings))
        command = ["-c", RAW] if raw else ["-m", "arena.recorder"]
        line, child = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        process = subprocess.Popen(
            [sys.executable, *command, str(folder / "recorder.json")],
            env={**os.environ, SOCKET_VARIABLE: str(child.fileno())},
            pass_fds=[child.fileno()],
        )
        child.close()
        recorder = psutil.Process(process.pid)
        while not json.loads(line.recv(1 << 16)).get("ready", False):
            pass
        time.sleep(1.0)
        lateness, usage = stream(senders, to, seconds, recorder)
        process.terminate()
        process.wait(60)
        report(senders, Recording(folder / "flight.mcap"), seconds, lateness, usage, counted(line))


def counted(line: socket.socket) -> int:
    """Return the number of lost datagrams in the last statistics of the recorder."""
    lost = 0
    while data := line.recv(1 << 16):
        lost = json.loads(data).get("stats", {}).get("lost_datagrams", lost)
    return lost


def stream(
    senders: list[Sender], to: tuple[str, int], seconds: float, recorder: psutil.Process
) -> tuple[float, list[tuple[float, float]]]:
    """Send all streams. Return the greatest lateness of a tick [s], and (CPU time [s], memory [MB]) at start, half and end."""
    began, worst, usage = time.monotonic(), 0.0, []
    ticks = round(seconds / TICK_S)
    for tick in range(ticks):
        if tick in (0, ticks // 2):
            usage.append(usage_of(recorder))
        due = began + tick * TICK_S
        while (left := due - time.monotonic()) > 0:
            time.sleep(left)
        worst = max(worst, -left)
        for sender in islice(senders, tick % DOWN_TICKS, None, DOWN_TICKS):
            sender.send(False, to)
        for sender in islice(senders, tick % UP_TICKS, None, UP_TICKS):
            sender.send(True, to)
    time.sleep(1.0)
    return worst, [*usage, usage_of(recorder)]


def usage_of(process: psutil.Process) -> tuple[float, float]:
    times = process.cpu_times()
    return times.user + times.system, process.memory_info().rss / 1e6


def report(
    senders: list[Sender],
    record: Recording,
    seconds: float,
    lateness: float,
    usage: list[tuple[float, float]],
    counted: int,
) -> None:
    """Print the result. counted: datagrams that did not fit into the recorder's socket, as it has reported."""
    sent = sum(sum(s.sent.values()) for s in senders)
    compared = [s.compare(record) for s in senders]
    lost, wrong = sum(lost for lost, _ in compared), sum(wrong for _, wrong in compared)
    cpu_s = usage[-1][0] - usage[0][0]
    print(f"{len(senders)} vehicles, {seconds:g} s: {sent} datagrams sent ({sent / seconds:.0f} per second)")
    print(f"  not in the record: {lost} (the kernel counted {counted}), at another place: {wrong}")
    print(f"  the sender was late by {1e3 * lateness:.0f} ms at most")
    print(
        f"  recorder: {100 * cpu_s / seconds:.1f} % of a core, {1e6 * cpu_s / sent:.1f} us per datagram, "
        f"{1e3 * cpu_s / seconds / len(senders):.2f} ms per vehicle and second"
    )
    print(f"  memory: {', '.join(f'{mb:.0f} MB' for _, mb in usage)} (start, half, end)")
    print(f"  file: {record.path.stat().st_size / 1e6 / seconds:.2f} MB per second")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[2, 10, 50])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--raw", action="store_true")
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    for count in given.vehicles:
        run(count, given.seconds, given.raw, given.keep)
    return 0


if __name__ == "__main__":
    sys.exit(main())
