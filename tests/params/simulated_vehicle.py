"""A simulated vehicle with parameters and a lossy link to it, in simulated time.

The vehicle encodes with pymavlink, unlike the code under test.
"""

from __future__ import annotations

import heapq
import math
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.params.transfer.reader import ParamReader
from arena.params.transfer.transfer import Transfer
from arena.params.transfer.writer import ParamWriter
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames

INT32, REAL32 = 6, 9
ME = 200  # our component
STEP_S, IDLE_STEP_S = 0.01, 0.02


def wire_value(value: float, kind: int) -> float:
    """Return the float whose bytes are those of an INT32 value, and a REAL32 value unchanged."""
    return struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == INT32 else value


def sixty_params() -> dict[str, tuple[float, int]]:
    """Return 60 parameters, name -> (value, type), half of them integers."""
    return {f"P_{i:02d}": ((i, INT32) if i % 2 else (i / 7, REAL32)) for i in range(60)}


@dataclass(kw_only=True)
class Vehicle:
    """A vehicle that answers parameter messages as PX4 does.

    params: name -> (value, type).
    clamp: name -> function that changes a written value.
    hidden: name -> the (name, value) of another parameter with which it exists.
    written_names: every name that was written, in order.
    errors: answer unknown names with PARAM_ERROR.
    """

    system: int = 1
    params: dict[str, tuple[float, int]] = field(default_factory=sixty_params)
    clamp: dict[str, Callable[[float], float]] = field(default_factory=dict)
    hidden: dict[str, tuple[str, float]] = field(default_factory=dict)
    armed: bool = False
    alive: bool = True
    answers: bool = True
    errors: bool = False
    per_turn: int = 20
    written_names: list[str] = field(default_factory=list)
    requests: int = 0
    rebooted: int = 0

    def __post_init__(self) -> None:
        self.codec = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self.decoder = mavlink.MAVLink(None)
        self._left: list[str] = []
        self._next_heartbeat = 0.0
        self._next_turn = 0.0

    def pack(self, message: Any) -> bytes:
        """Return a message as a frame of this vehicle."""
        return bytes(message.pack(self.codec))

    @property
    def names(self) -> list[str]:
        return sorted(name for name in self.params if self._exists(name))

    def step(self, now: float) -> list[bytes]:
        if not self.alive:
            return []
        out = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + 1.0
            out.append(self.pack(mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * self.armed, 0, 3, 3)))
        if now >= self._next_turn:
            self._next_turn = now + 0.05
            turn, self._left = self._left[: self.per_turn], self._left[self.per_turn :]
            out += [self.hash() if name == "_HASH_CHECK" else self.value(name) for name in turn]
        return out

    def receive(self, data: bytes) -> list[bytes]:
        if not self.alive:
            return []
        out = []
        for frame in parse_frames(data).frames:
            m = self.decoder.decode(bytearray(data[frame.start : frame.end]))
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
        self.written_names.append(name)
        self.params[name] = (self.clamp[name](value) if name in self.clamp else value, kind)

    def value(self, name: str) -> bytes:
        value, kind = self.params[name]
        names = self.names
        return self.pack(
            mavlink.MAVLink_param_value_message(
                name.encode(), wire_value(value, kind), kind, len(names), names.index(name)
            )
        )

    def hash(self) -> bytes:
        return self.pack(mavlink.MAVLink_param_value_message(b"_HASH_CHECK", 0.5, 5, len(self.names), 65535))

    def error(self, name: str, error: int = 1) -> bytes:
        """Return a PARAM_ERROR frame; not every version of the dialect has the message."""
        return Codec(self.system, 1).frame(345, struct.pack("<hBB16sB", -1, 252, 200, name.encode(), error))

    def _exists(self, name: str) -> bool:
        if name in self.hidden:
            by, value = self.hidden[name]
            return self.params[by][0] == value
        return name in self.params


class LossyLink:
    """A link with loss, delay, duplicates and late packets.

    loss: share of lost packets, each way [-].
    delay_s: delay each way, within 10 % [s].
    twice: share of packets delivered twice [-].
    late: share of packets with four times the delay [-].
    counted: packets sent, by direction.
    """

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

    @property
    def next_arrival(self) -> float:
        """Time of the next arrival [s]; infinite when nothing is on its way."""
        return self._flying[0][0] if self._flying else math.inf

    def arrived(self, now: float) -> list[tuple[str, bytes]]:
        found = []
        while self._flying and self._flying[0][0] <= now:
            _, _, way, data = heapq.heappop(self._flying)
            found.append((way, data))
        return found


def lossy_link(seed: int) -> LossyLink:
    """Return a link with 10 % loss each way, 100 ms delay, 5 % duplicates and 5 % of packets late by 300 ms."""
    return LossyLink(seed=seed, loss=0.10, delay_s=0.10, twice=0.05, late=0.05)


def run(
    core: Transfer,
    vehicle: Vehicle,
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
                for answer in vehicle.receive(data):
                    link.send("down", answer, now)
            else:
                for frame in parse_frames(data).frames:
                    core.receive(data, frame, now)
        sent = [("down", data) for data in vehicle.step(now)] + [("up", data) for data in core.due(now)]
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


def holds(vehicle: Vehicle, wanted: dict[str, float]) -> bool:
    return all(math.isclose(vehicle.params[name][0], value, rel_tol=1e-6) for name, value in wanted.items())


def outcomes(core: ParamWriter) -> dict[str, str]:
    return {name: result.outcome for name, result in core.result.items()}
