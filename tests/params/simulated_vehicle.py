"""A vehicle with parameters and the air between it and us, in simulated time. It speaks pymavlink, which we do not."""

from __future__ import annotations

import heapq
import math
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.params.transfer.reader import Reader
from arena.params.transfer.transfer import Transfer
from arena.params.transfer.writer import Writer
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

INT32, REAL32 = 6, 9
ME = 200  # our component
STEP_S = 0.01


def carried(value: float, kind: int) -> float:
    return struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == INT32 else value


def sixty() -> dict[str, tuple[float, int]]:
    """Name -> (value, type), half of them integers."""
    return {f"P_{i:02d}": ((i, INT32) if i % 2 else (i / 7, REAL32)) for i in range(60)}


@dataclass(kw_only=True)
class Vehicle:
    """params: name -> (value, type).  clamp: name -> what a write becomes.  hidden: name -> the (name, value) that reveals it.

    told: every name that was set, in order.  errors: answer unknown names with PARAM_ERROR.
    """

    system: int = 1
    params: dict[str, tuple[float, int]] = field(default_factory=sixty)
    clamp: dict[str, Callable[[float], float]] = field(default_factory=dict)
    hidden: dict[str, tuple[str, float]] = field(default_factory=dict)
    armed: bool = False
    alive: bool = True
    answers: bool = True
    errors: bool = False
    per_turn: int = 20
    told: list[str] = field(default_factory=list)
    requests: int = 0
    rebooted: int = 0

    def __post_init__(self) -> None:
        self.voice = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self.ear = mavlink.MAVLink(None)
        self._left: list[str] = []
        self._next_beat = 0.0
        self._next_turn = 0.0

    def pack(self, message: Any) -> bytes:
        return bytes(message.pack(self.voice))

    @property
    def names(self) -> list[str]:
        return sorted(name for name in self.params if self._exists(name))

    def step(self, now: float) -> list[bytes]:
        if not self.alive:
            return []
        out = []
        if now >= self._next_beat:
            self._next_beat = now + 1.0
            out.append(self.pack(mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * self.armed, 0, 3, 3)))
        if now >= self._next_turn:
            self._next_turn = now + 0.05
            turn, self._left = self._left[: self.per_turn], self._left[self.per_turn :]
            out += [self.hash() if name == "_HASH_CHECK" else self.value(name) for name in turn]
        return out

    def hear(self, data: bytes) -> list[bytes]:
        if not self.alive:
            return []
        out = []
        for frame in parse_frames(data).frames:
            m = self.ear.decode(bytearray(data[frame.start : frame.end]))
            if getattr(m, "target_system", None) == self.system and m.target_component == 1:
                self.requests += 1
                out += self._answer(m) if self.answers else []
        return out

    def _answer(self, m: Any) -> list[bytes]:
        kind = m.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._left = self.names if self._left else ["_HASH_CHECK", *self.names]
        elif kind == "COMMAND_LONG":
            self.rebooted += m.command == 246
            return [
                self.pack(
                    mavlink.MAVLink_command_ack_message(
                        m.command, 0, 0, 0, m.get_srcSystem(), m.get_srcComponent()
                    )
                )
            ]
        elif kind == "PARAM_REQUEST_READ" and m.param_index >= 0:
            return [self.value(self.names[m.param_index])] if m.param_index < len(self.names) else []
        elif not self._exists(m.param_id):
            return [self.error(m.param_id)] if self.errors else []
        elif kind == "PARAM_SET" and m.param_type == self.params[m.param_id][1]:
            self.set(m.param_id, m.param_value)
            return [self.value(m.param_id)]
        elif kind == "PARAM_REQUEST_READ":
            return [self.value(m.param_id)]
        return []

    def set(self, name: str, raw: float) -> None:
        kind = self.params[name][1]
        value = struct.unpack("<i", struct.pack("<f", raw))[0] if kind == INT32 else raw
        self.told.append(name)
        self.params[name] = (self.clamp[name](value) if name in self.clamp else value, kind)

    def value(self, name: str) -> bytes:
        value, kind = self.params[name]
        names = self.names
        return self.pack(
            mavlink.MAVLink_param_value_message(
                name.encode(), carried(value, kind), kind, len(names), names.index(name)
            )
        )

    def hash(self) -> bytes:
        return self.pack(mavlink.MAVLink_param_value_message(b"_HASH_CHECK", 0.5, 5, len(self.names), 65535))

    def error(self, name: str, error: int = 1) -> bytes:
        """PARAM_ERROR, which is not in every version's dialect."""
        return Codec(self.system, 1).frame(345, struct.pack("<hBB16sB", -1, 252, 200, name.encode(), error))

    def _exists(self, name: str) -> bool:
        if name in self.hidden:
            by, value = self.hidden[name]
            return self.params[by][0] == value
        return name in self.params


class Air:
    """Loses a share each way, holds back by delay_s, some longer, and gives some twice. counted: packets that went out."""

    def __init__(
        self, *, seed: int = 1, loss: float = 0.0, delay_s: float = 0.0, twice: float = 0.0, late: float = 0.0
    ) -> None:
        self.rng = random.Random(seed)
        self.loss, self.delay_s, self.twice, self.late = loss, delay_s, twice, late
        self._flying: list[tuple[float, int, str, bytes]] = []
        self.counted = {"up": 0, "down": 0}

    def send(self, way: str, data: bytes, now: float) -> None:
        self.counted[way] += 1
        for _ in range(1 + (self.rng.random() < self.twice)):
            if self.rng.random() >= self.loss:
                delay = self.delay_s * (1 + 3 * (self.rng.random() < self.late)) * self.rng.uniform(0.9, 1.1)
                heapq.heappush(self._flying, (now + delay, self.rng.getrandbits(60), way, data))

    def arrived(self, now: float) -> list[tuple[str, bytes]]:
        found = []
        while self._flying and self._flying[0][0] <= now:
            _, _, way, data = heapq.heappop(self._flying)
            found.append((way, data))
        return found


def rough(seed: int) -> Air:
    """10 % loss each way and 100 ms of delay, a twentieth given twice, a twentieth late by 300 ms."""
    return Air(seed=seed, loss=0.10, delay_s=0.10, twice=0.05, late=0.05)


def run(
    core: Transfer,
    vehicle: Vehicle,
    air: Air,
    *,
    limit_s: float = 120.0,
    each: Callable[[float], None] | None = None,
) -> float:
    """Until the core is done. Returns how long it took [s] of simulated time."""
    now = 0.0
    while not core.done:
        assert now < limit_s, f"not done within {limit_s} s: {core.progress}"
        for way, data in air.arrived(now):
            if way == "up":
                for answer in vehicle.hear(data):
                    air.send("down", answer, now)
            else:
                for frame in parse_frames(data).frames:
                    core.hear(data, frame, now)
        for data in vehicle.step(now):
            air.send("down", data, now)
        for data in core.due(now):
            air.send("up", data, now)
        if each is not None:
            each(now)
        now += STEP_S
    return now


def writer(wanted: dict[str, float], **more: Any) -> Writer:
    return Writer(system=1, component=ME, now=0.0, wanted=wanted, **more)


def reader(names: list[str] | None = None) -> Reader:
    return Reader(system=1, component=ME, now=0.0, names=names)


def others() -> dict[str, float]:
    """Other values for all sixty."""
    return {
        name: (value * 3 + 1 if kind == INT32 else value + 0.1) for name, (value, kind) in sixty().items()
    }


def holds(vehicle: Vehicle, wanted: dict[str, float]) -> bool:
    return all(math.isclose(vehicle.params[name][0], value, rel_tol=1e-6) for name, value in wanted.items())


def outcomes(core: Writer) -> dict[str, str]:
    return {name: result.outcome for name, result in core.result.items()}
