"""`python benchmarks/router.py`: cost of the router, compared with a plain forwarding loop that parses nothing, in the same run.

K vehicles with 3 clients each; per vehicle 350 messages a second up and 110 down, 71 bytes, as PX4's streams. Prints latency
through the router (median and p99, up: vehicle -> program, down: program -> vehicle), CPU per million messages in, memory,
loss, and the ratio of its CPU time to the loop's. Takes about half a minute.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import socket
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from fastcrc import crc16

UP_HZ, DOWN_HZ, PAYLOAD = 350, 110, 59
ATTITUDE, COMMAND_LONG = (30, b"\x27"), (76, b"\x98")  # message id and CRC seed
HOST, BASE = "127.54.200.1", 24000
TICK_S = 0.001
STAMP = struct.Struct("<q")


def message(kind: tuple[int, bytes], system: int, component: int) -> bytearray:
    """Return a frame of 71 bytes whose first 8 payload bytes are for the time. Byte 30 of a command is its target."""
    number, seed = kind
    payload = bytearray([1] * PAYLOAD)
    payload[30], payload[31] = system, 1
    frame = bytearray([0xFD, PAYLOAD, 0, 0, 0, system, component, number, 0, 0]) + payload
    return frame + seed + b"\x00"


def stamped(frame: bytearray) -> bytes:
    """Return a frame of `message` with the present time and a correct CRC."""
    STAMP.pack_into(frame, 10, time.monotonic_ns())
    crc = crc16.mcrf4xx(frame[1 : 11 + PAYLOAD])
    return bytes(frame[: 10 + PAYLOAD]) + crc.to_bytes(2, "little")


def table(count: int) -> dict:
    vehicles = [
        {
            "name": f"v{k}",
            "id": k,
            "link": {"local": [HOST, BASE + 10 * k + 1], "remote": [HOST, BASE + 10 * k]},
            "serve": [HOST, BASE + 10 * k + 8],
            "tools": [HOST, BASE + 10 * k + 6],
            "clients": [
                {"name": "program", "address": [HOST, 16000 + k]},
                {"name": "sdk", "address": [HOST, 22000 + k]},
                {"name": "other", "address": [HOST, BASE + 10 * k + 7]},
            ],
        }
        for k in range(1, count + 1)
    ]
    return {
        "name": "router",
        "vehicles": vehicles,
        "gcs_local": [HOST, BASE],
        "gcs": [],
        "heartbeat": False,
        "simulated": True,
    }


def udp(address: list) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    s.bind(tuple(address))
    return s


def bare(file: str) -> None:
    """Run the loop to compare with: receiving socket -> destinations, nothing else."""
    routes = {}
    for v in json.loads(Path(file).read_text())["vehicles"]:
        link, serve = udp(v["link"]["local"]), udp(v["serve"])
        listeners = [tuple(c["address"]) for c in v["clients"]]
        routes[link.fileno()] = link, serve, listeners
        routes[serve.fileno()] = serve, link, [tuple(v["link"]["remote"])]
    poll = select.epoll()
    for fd in routes:
        poll.register(fd, select.EPOLLIN)
    buffer = memoryview(bytearray(65536))
    while True:
        for fd, _ in poll.poll():
            source, through, destinations = routes[fd]
            size, _ = source.recvfrom_into(buffer)
            for dest in destinations:
                through.sendto(buffer[:size], dest)


@dataclass(kw_only=True)
class Load:
    """The vehicles and programs of one measurement. The other two clients of each vehicle have open sockets that are not read."""

    count: int
    up: list[int] = field(default_factory=list)
    down: list[int] = field(default_factory=list)
    sent: int = 0

    def __post_init__(self) -> None:
        vehicles = table(self.count)["vehicles"]
        self.links = [udp(v["link"]["remote"]) for v in vehicles]
        self.programs = [udp(v["clients"][0]["address"]) for v in vehicles]
        self.unread = [udp(a) for v in vehicles for a in (c["address"] for c in v["clients"][1:])]
        self.to = [(tuple(v["link"]["local"]), tuple(v["serve"])) for v in vehicles]
        self.frames = [(message(ATTITUDE, v["id"], 1), message(COMMAND_LONG, v["id"], 191)) for v in vehicles]
        self.poll = select.epoll()
        self.receivers = {s.fileno(): (s, self.up) for s in self.programs} | {
            s.fileno(): (s, self.down) for s in self.links
        }
        for fd in self.receivers:
            self.poll.register(fd, select.EPOLLIN)

    def run(self, seconds: float) -> None:
        began = time.monotonic()
        done = 0
        while (now := time.monotonic() - began) < seconds:
            due = int(now * UP_HZ * self.count)
            for i in range(done, due):
                self.send(i)
            done = due
            self.receive(TICK_S)
        while self.receive(0.05):
            pass

    def send(self, i: int) -> None:
        k = i % self.count
        self.links[k].sendto(stamped(self.frames[k][0]), self.to[k][0])
        self.sent += 1
        if (i // self.count) * DOWN_HZ % UP_HZ < DOWN_HZ:
            self.programs[k].sendto(stamped(self.frames[k][1]), self.to[k][1])
            self.sent += 1

    def receive(self, timeout_s: float) -> int:
        ready = self.poll.poll(timeout_s)
        for fd, _ in ready:
            s, latencies = self.receivers[fd]
            data = s.recv(2048)
            latencies.append(time.monotonic_ns() - STAMP.unpack_from(data, 10)[0])
        return len(ready)

    def close(self) -> None:
        self.poll.close()
        for s in (*self.links, *self.programs, *self.unread):
            s.close()


def percentiles(values: list[int]) -> str:
    """Return median and p99 in microseconds."""
    ordered = sorted(values) or [0]
    return f"{ordered[len(ordered) // 2] / 1e3:.0f}/{ordered[len(ordered) * 99 // 100] / 1e3:.0f}"


def measure(command: list[str], count: int, seconds: float) -> tuple[float, str]:
    """Return (CPU seconds per million messages in, the row's figures)."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "slice.json"
        file.write_text(json.dumps(table(count)))
        load = Load(count=count)
        process = subprocess.Popen(
            [*command, str(file)], env={k: v for k, v in os.environ.items() if k != "ARENA_FD"}
        )
        try:
            while not load.up:
                load.send(0)
                load.receive(0.05)
            load.run(0.3)
            load.up.clear(), load.down.clear()
            load.sent, spent = 0, psutil.Process(process.pid).cpu_times()
            load.run(seconds)
            after, memory = (
                psutil.Process(process.pid).cpu_times(),
                psutil.Process(process.pid).memory_info().rss,
            )
        finally:
            process.kill()
            process.wait()
            load.close()
    cpu = (after.user + after.system - spent.user - spent.system) / load.sent * 1e6
    lost = 1 - (len(load.up) + len(load.down)) / load.sent
    return (
        cpu,
        f"{percentiles(load.up):>10} {percentiles(load.down):>10} {cpu:8.1f} {memory / 2**20:8.0f} {lost:8.1%}",
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 10, 50])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--bare", metavar="SLICE", help=argparse.SUPPRESS)
    a = parser.parse_args()
    if a.bare:
        bare(a.bare)
    print(f"{'':>8} {'K':>3} {'up us':>10} {'down us':>10} {'CPU s/M':>8} {'MiB':>8} {'lost':>8}   ratio")
    for count in a.vehicles:
        base, row = measure([sys.executable, __file__, "--bare"], count, a.seconds)
        print(f"{'bare':>8} {count:3d} {row}")
        own, row = measure([sys.executable, "-m", "arena.mavlink_router"], count, a.seconds)
        print(f"{'router':>8} {count:3d} {row}   {own / base:.2f}")


if __name__ == "__main__":
    main()
