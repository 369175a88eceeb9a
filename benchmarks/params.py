"""How long sixty parameters take to be written: one vehicle and ten at once, on a clean link and on one that loses and delays.

python benchmarks/params.py [--repeat N] [--params N] [--vehicles N] [--address 127.26.250.1]

The vehicles are built-in autopilots in a world of their own process; a relay stands between them and the writer, loses a share of
the packets each way and holds them back. Every push reads first, writes, and reads back: three exchanges a parameter. Seconds are
of wall time, until the slowest vehicle has its values; packets are those of one vehicle: to it, and PARAM_VALUEs from it.
"""

from __future__ import annotations

import argparse
import contextlib
import heapq
import itertools
import json
import random
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import mean

from arena.autopilot.param_table import SPECS
from arena.params.transfer.session import Report, Target, push
from arena.plan import make_plan
from arena.schema import load_arena

LINKS = {"clean": (0.0, 0.0), "10 % lost, 100 ms": (0.10, 0.10)}
UP_S = 60.0
Address = tuple[str, int]


class Line:
    """Where the router would be: the autopilot's partner on one side, a door for the writer on the other."""

    def __init__(self, autopilot: Address, partner: Address) -> None:
        self.far, self.near = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.far.bind(partner)
        self.near.bind((partner[0], 0))
        self.autopilot, self.writer = autopilot, autopilot

    def pass_on(self, way: str, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self.far.sendto(data, self.autopilot) if way == "up" else self.near.sendto(data, self.writer)


class Relay(threading.Thread):
    """loss: share of the packets, each way.  delay_s: each way."""

    def __init__(self, lines: list[Line]) -> None:
        super().__init__(daemon=True)
        self.loss = self.delay_s = 0.0
        self.over = threading.Event()
        self._ends = {
            end: (line, way) for line in lines for end, way in ((line.near, "up"), (line.far, "down"))
        }

    def run(self) -> None:
        rng, number = random.Random(1), itertools.count()
        flying: list[tuple[float, int, Line, str, bytes]] = []
        while not self.over.is_set():
            for end in select.select(list(self._ends), [], [], 0.002)[0]:
                data, sender = end.recvfrom(65536)
                line, way = self._ends[end]
                if way == "up":
                    line.writer = sender
                if rng.random() >= self.loss:
                    heapq.heappush(flying, (time.monotonic() + self.delay_s, next(number), line, way, data))
            while flying and flying[0][0] <= time.monotonic():
                _, _, line, way, data = heapq.heappop(flying)
                line.pass_on(way, data)


@contextlib.contextmanager
def world(vehicles: int, address: str) -> Iterator[tuple[Relay, dict[str, Target]]]:
    """A world of built-in autopilots, and the relay that leads to them."""
    with tempfile.TemporaryDirectory(prefix="p-") as name:
        folder = Path(name)
        file = folder / "arena.yaml"
        rows = "".join(
            f"  uav{k}: {{start: {{position: [0, {2 * k - vehicles}, 0]}}}}\n" for k in range(1, vehicles + 1)
        )
        file.write_text(
            f"address: {address}\nworld: {{size: [30, 30, 10]}}\ndefaults: {{autopilot: builtin}}\nvehicles:\n{rows}"
        )
        settings = next(s for s in make_plan(load_arena(file)).slices.values() if s["name"] == "world")
        slice_ = folder / "world.json"
        slice_.write_text(json.dumps(settings).replace("{run}", name).replace("{rt}", name))
        with (folder / "world.log").open("wb") as log:
            child = subprocess.Popen([sys.executable, "-m", "arena.sim", str(slice_)], stdout=log, stderr=log)
        rows_ = settings["vehicles"]
        lines = [
            Line(tuple(v["links"]["router"]["local"]), tuple(v["links"]["router"]["remote"])) for v in rows_
        ]
        relay = Relay(lines)
        try:
            if not select.select([line.far for line in lines], [], [], UP_S)[0]:
                raise SystemExit(f"the world says nothing: {(folder / 'world.log').read_text()}")
            relay.start()
            pairs = zip(rows_, lines, strict=True)
            yield (
                relay,
                {v["name"]: Target(system=v["id"], remote=line.near.getsockname()) for v, line in pairs},
            )
        finally:
            relay.over.set()
            child.terminate()
            child.wait()


def two_values(number: int) -> tuple[dict[str, float], dict[str, float]]:
    """So many parameters, integers and floats, and two values that each may have."""
    pairs = {}
    for name, spec in SPECS.items():
        tried = (spec.default + 1, spec.default - 1, spec.default * 0.9 + 0.01)
        fit = [v for v in tried if spec.low <= v <= spec.high and (spec.type == "float" or v == int(v))]
        if fit and not name.startswith(("MAV_", "SYS_")):
            pairs[name] = (fit[0], spec.default)
    chosen = dict(list(pairs.items())[:number])
    return {n: a for n, (a, _) in chosen.items()}, {n: b for n, (_, b) in chosen.items()}


def line_of(link: str, vehicles: int, runs: list[dict[str, Report]]) -> str:
    seconds = [max(r.traffic.seconds for r in run.values()) for run in runs]
    reports = [r for run in runs for r in run.values()]
    right = sum(r.holds for r in reports)
    sent, heard = (mean(getattr(r.traffic, what) for r in reports) for what in ("sent", "heard"))
    spread = f"{min(seconds):.2f} .. {max(seconds):.2f}"
    return f"{link:<18} {vehicles:>8} {mean(seconds):>8.2f} {spread:>15} {sent:>8.0f} {heard:>8.0f} {right:>5} of {len(reports)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--params", type=int, default=60)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--address", default="127.26.250.1")
    given = parser.parse_args()
    values = itertools.cycle(two_values(given.params))
    print(
        f"{'link':<18} {'vehicles':>8} {'mean s':>8} {'least .. most':>15} {'sent':>8} {'heard':>8} {'right':>5}"
    )
    with world(given.vehicles, given.address) as (relay, targets):
        for link, (loss, delay_s) in LINKS.items():
            relay.loss, relay.delay_s = loss, delay_s
            for some in (dict(list(targets.items())[:1]), targets):
                runs = []
                for _ in range(given.repeat):
                    wanted = next(values)
                    runs.append(push(some, dict.fromkeys(some, wanted)))
                    if len(some) == 1:  # the others shall have something to do as well, in the same order
                        relay.loss, relay.delay_s = 0.0, 0.0
                        push(targets, dict.fromkeys(targets, wanted))
                        relay.loss, relay.delay_s = loss, delay_s
                print(line_of(link, len(some), runs), flush=True)


if __name__ == "__main__":
    main()
