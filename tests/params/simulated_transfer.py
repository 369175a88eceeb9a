"""A parameter transfer between the code under test and a fake autopilot, in simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from fake_autopilot import INT32, REAL32, FakeAutopilot
from served import LossyLink

from arena.params.transfer.reader import ParamReader
from arena.params.transfer.transfer import Transfer
from arena.params.transfer.writer import ParamWriter
from arena.wire.mavlink_frame import parse_frames

ME = 200  # our component
STEP_S, IDLE_STEP_S = 0.01, 0.02


def sixty_params() -> dict[str, tuple[float, int]]:
    """Return 60 parameters, name -> (value, type), half of them integers."""
    return {f"P_{i:02d}": ((i, INT32) if i % 2 else (i / 7, REAL32)) for i in range(60)}


def vehicle(system: int = 1, **changes: Any) -> FakeAutopilot:
    """Return an autopilot with 60 parameters and a heartbeat once a second, unless changed."""
    usual = {"params": sixty_params(), "telemetry": ("HEARTBEAT",), "period_s": 1.0}
    return FakeAutopilot(system=system, **(usual | changes))


def lossy_link(seed: int) -> LossyLink:
    """Return a link with 10 % loss each way, 100 ms delay, 5 % duplicates and 5 % of packets late by 300 ms."""
    return LossyLink(seed=seed, loss=0.10, delay_s=0.10, twice=0.05, late=0.05)


def run(
    core: Transfer,
    autopilot: FakeAutopilot,
    link: LossyLink,
    *,
    limit_s: float = 120.0,
    each: Callable[[float], None] | None = None,
) -> float:
    """Run a transfer until it is done and return the simulated time that it took [s].

    limit_s: fail after this time [s].
    each: callback after every step.
    """
    now = 0.0
    while not core.done:
        assert now < limit_s, f"not done within {limit_s} s: {core.progress}"
        arrived = link.arrived(now)
        for way, data in arrived:
            if way == "up":
                for answer in autopilot.receive(data, now):
                    link.send("down", answer, now)
            else:
                for frame in parse_frames(data).frames:
                    core.receive(data, frame, now)
        sent = [("down", data) for data in autopilot.step(now)] + [("up", data) for data in core.due(now)]
        for way, data in sent:
            link.send(way, data, now)
        if each is not None:
            each(now)
        now += STEP_S
        if not arrived and not sent:  # nothing happens before the next arrival: take longer steps
            now = max(now, min(link.next_arrival, now + IDLE_STEP_S))
    return now


def writer(wanted: dict[str, float], **more: Any) -> ParamWriter:
    return ParamWriter(system=1, component=ME, now=0.0, wanted=wanted, **more)


def reader(names: list[str] | None = None) -> ParamReader:
    return ParamReader(system=1, component=ME, now=0.0, names=names)


def new_values() -> dict[str, float]:
    """Return another value for each of the 60 parameters."""
    return {
        name: (value * 3 + 1 if kind == INT32 else value + 0.1)
        for name, (value, kind) in sixty_params().items()
    }


def holds(autopilot: FakeAutopilot, wanted: dict[str, float]) -> bool:
    return all(math.isclose(autopilot.params[name][0], value, rel_tol=1e-6) for name, value in wanted.items())


def outcomes(core: ParamWriter) -> dict[str, str]:
    return {name: result.outcome for name, result in core.result.items()}
