"""Time to write 60 parameters: to one vehicle and to ten at the same time, over a clean and over a lossy link.

python benchmarks/params.py [--repeat N] [--params N] [--vehicles N] [--address 127.26.250.1]

The vehicles are built-in autopilots in a world process; a relay between them and the writer loses a share of the packets each way and
delays them. Every push reads first, writes, and reads back: three exchanges per parameter. Times are wall time [s] until the slowest
vehicle has its values; packets are those of one vehicle: frames sent to it, and PARAM_VALUEs received from it.
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

from arena.builtin_parameters import SPECS
from arena.params.transfer.session import PushReport, push
from arena.params.transfer.transports import ParamTarget
from arena.plan import make_plan
from arena.schema import load_arena

LINKS = {"clean": (0.0, 0.0), "10 % lost, 100 ms": (0.10, 0.10)}
UP_S = 60.0
Address = tuple[str, int]


class Line:
    """The place of the router: a socket for the autopilot (far) and one for the writer (near)."""

    def __init__(self, autopilot: Address, partner: Address) -> None:
        self.far, self.near = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.far.bind(partner)
        self.near.bind((partner[0], 0))
        self.autopilot, self.writer = autopilot, autopilot

    def pass_on(self, way: str, data: bytes) -> None:
        """Send a packet on. way: "up" to the autopilot, "down" to the writer."""
        with contextlib.suppress(OSError):
            self.far.sendto(data, self.autopilot) if way == "up" else self.near.sendto(data, self.writer)


class Relay(threading.Thread):
    """A thread that passes packets on with loss and delay. loss: share each way [-].  delay_s: each way [s]."""

    def __init__(self, lines: list[Line]) -> None:
        super().__init__(daemon=True)
        self.loss = self.delay_s = 0.0
        self.stopped = threading.Event()
        self._ends = {
            end: (line, way) for line in lines for end, way in ((line.near, "up"), (line.far, "down"))
        }

    def run(self) -> None:
        rng, number = random.Random(1), itertools.count()
        flying: list[tuple[float, int, Line, str, bytes]] = []
        while not self.stopped.is_set():
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
def world(vehicles: int, address: str) -> Iterator[tuple[Relay, dict[str, ParamTarget]]]:
    """Start a world of built-in autopilots and yield the relay and the vehicles' targets."""
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
                raise SystemExit(
                    f"no MAVLink from the world for {UP_S:g} s: {(folder / 'world.log').read_text()}"
                )
            relay.start()
            pairs = zip(rows_, lines, strict=True)
            yield (
                relay,
                {v["name"]: ParamTarget(system=v["id"], remote=line.near.getsockname()) for v, line in pairs},
            )
        finally:
            relay.stopped.set()
            child.terminate()
            child.wait()


def two_values(number: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return two sets of allowed values for this number of parameters, integers and floats."""
    pairs = {}
    for name, spec in SPECS.items():
        candidates = (spec.default + 1, spec.default - 1, spec.default * 0.9 + 0.01)
        fit = [v for v in candidates if spec.low <= v <= spec.high and (spec.type == "float" or v == int(v))]
        if fit and not name.startswith(("MAV_", "SYS_")):
            pairs[name] = (fit[0], spec.default)
    chosen = dict(list(pairs.items())[:number])
    return {n: a for n, (a, _) in chosen.items()}, {n: b for n, (_, b) in chosen.items()}


def result_line(link: str, vehicles: int, runs: list[dict[str, PushReport]]) -> str:
    seconds = [max(r.traffic.seconds for r in run.values()) for run in runs]
    reports = [r for run in runs for r in run.values()]
    right = sum(r.holds for r in reports)
    sent, received = (mean(getattr(r.traffic, what) for r in reports) for what in ("sent", "received"))
    spread = f"{min(seconds):.2f} .. {max(seconds):.2f}"
    return f"{link:<18} {vehicles:>8} {mean(seconds):>8.2f} {spread:>15} {sent:>8.0f} {received:>8.0f} {right:>5} of {len(reports)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--params", type=int, default=60)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--address", default="127.26.250.1")
    given = parser.parse_args()
    values = itertools.cycle(two_values(given.params))
    print(
        f"{'link':<18} {'vehicles':>8} {'mean s':>8} {'min .. max':>15} {'sent':>8} {'received':>8} {'right':>5}"
    )
    with world(given.vehicles, given.address) as (relay, targets):
        for link, (loss, delay_s) in LINKS.items():
            relay.loss, relay.delay_s = loss, delay_s
            for some in (dict(list(targets.items())[:1]), targets):
                runs = []
                for _ in range(given.repeat):
                    wanted = next(values)
                    runs.append(push(some, dict.fromkeys(some, wanted)))
                    if (
                        len(some) == 1
                    ):  # write the same values to the other vehicles, so that the next push of all has something to write
                        relay.loss, relay.delay_s = 0.0, 0.0
                        push(targets, dict.fromkeys(targets, wanted))
                        relay.loss, relay.delay_s = loss, delay_s
                print(result_line(link, len(some), runs), flush=True)


if __name__ == "__main__":
    main()
