"""Hand-made moments, and a copilot that is fed by hand: bytes by pymavlink, poses by arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.copilot.braking import BrakingLimits, predict_stops
from arena.copilot.copilot import Copilot, Output
from arena.copilot.fleet_state import FleetState
from arena.copilot.settings import Rules, Vehicle
from arena.mocap.client import CapturedFrame, Pose
from arena.schema.copilot import RULES
from arena.schema.copilot import Copilot as Section
from arena.wire.mavlink_codec import Codec
from arena.wire.px4_mode import mode_numbers

LEVEL = (1.0, 0.0, 0.0, 0.0)
PERIOD_S = 0.02


def rules(**given: Any) -> Rules:
    """The YAML's section, as the plan slices it."""
    section = Section.model_validate(given)
    each = {rule: getattr(section, rule).model_dump() for rule in RULES}
    settings = {
        "rules": each,
        "at_most": section.at_most,
        "escalate_after_s": section.escalate_after_s,
        "latency_s": 0.01,
    }
    return Rules.of(settings)


def vehicle(number: int, half: tuple[float, float] = (6.0, 6.0), up: float = 3.0) -> Vehicle:
    return Vehicle.of(
        {
            "name": f"uav{number}",
            "id": number,
            "body": f"uav{number}",
            "simulated": True,
            "poses": True,
            "tools": ["127.0.0.1", 24000 + 10 * number + 6],
            "panic": ["127.0.0.1", 24000 + 10 * number + 4],
            "fence": {"north": [-half[0], half[0]], "east": [-half[1], half[1]], "up": up},
            "braking": {"accel": 3.0, "jerk": 4.0, "up": 3.0, "down": 4.0},
        }
    )


def limits(n: int) -> BrakingLimits:
    return BrakingLimits(
        accel=np.full(n, 3.0), jerk=np.full(n, 4.0), up=np.full(n, 3.0), down=np.full(n, 4.0)
    )


def moment(
    p_n: Sequence[Sequence[float]], v_n: Sequence[Sequence[float]] | None = None, **given: Any
) -> FleetState:
    """All flying in OFFBOARD, captured, healthy, commanded to no place, unless given otherwise."""
    p, n = np.array(p_n, float), len(p_n)
    v = np.zeros((n, 3)) if v_n is None else np.array(v_n, float)
    yes, no, nan = np.ones(n, bool), np.zeros(n, bool), np.full(n, np.nan)
    fields: dict[str, Any] = {
        "now": 10.0,
        "flying": yes,
        "open": yes,
        "held": no,
        "placed": yes,
        "moving": yes,
        "p_n": p,
        "v_n": v,
        "pose_age": np.zeros(n),
        "tilt": np.zeros(n),
        "stop": predict_stops(p, v, np.zeros((n, 3)), np.full(n, 0.05), limits(n)),
        "target": np.full((n, 3), np.nan),
        "settled": no,
        "off": np.zeros(n),
        "battery": np.ones(n),
        "offboard": yes,
        "silent_s": nan,
    }
    return FleetState(
        **{**fields, **{key: np.array(x) if isinstance(x, list) else x for key, x in given.items()}}
    )


class Scene:
    """Vehicles that are where one puts them and say what one lets them say; `run` steps the copilot."""

    def __init__(self, count: int = 1, section: dict[str, Any] | None = None) -> None:
        self.now = 100.0
        self.core = Copilot(rules(**(section or {})), [vehicle(i + 1) for i in range(count)], self.now)
        self.p = np.tile([0.0, 0.0, -1.0], (count, 1))
        self.p[:, 0] = 2.0 * np.arange(count)
        self.v, self.turn = np.zeros((count, 3)), [LEVEL] * count
        self.mode, self.armed, self.landed, self.battery = (
            ["OFFBOARD"] * count,
            [True] * count,
            [False] * count,
            [90] * count,
        )
        self.captured, self.speaks, self.beats = [True] * count, [True] * count, [False] * count
        self.estimate_off = np.zeros((count, 3))
        self.events: list[str] = []
        self.sent: list[tuple[float, int, Any]] = []
        self._codecs = [Codec(i + 1, 1) for i in range(count)]
        self._programs = [Codec(i + 1, 191) for i in range(count)]
        self._ear = mavlink.MAVLink(None)
        self._frame = 0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.now += PERIOD_S
            self.p = self.p + self.v * PERIOD_S
            self._capture()
            for i in range(len(self.p)):
                self._speak(i)
            self._note(self.core.step(self.now))

    def commands(self, row: int = 0) -> list[str]:
        """What this vehicle was told, each step once in a row: the words of modes, or `terminate`."""
        words = [word for _, r, m in self.sent if r == row and (word := _word(m))]
        return [w for i, w in enumerate(words) if i == 0 or words[i - 1] != w]

    def _capture(self) -> None:
        self._frame += 1
        seen = tuple(
            Pose(f"uav{i + 1}", (float(p[0]), float(p[1]), float(p[2]) + 1e-9 * self._frame), self.turn[i])
            for i, p in enumerate(self.p)
            if self.captured[i]
        )
        self.core.on_frames([CapturedFrame(self._frame, self.now, seen, ())], self.now)

    def _speak(self, i: int) -> None:
        if self.beats[i]:
            beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
            self.core.on_datagram(None, self._programs[i].pack(beat), self.now)
        if not self.speaks[i]:
            return
        main, sub = mode_numbers(self.mode[i])
        armed = 128 if self.armed[i] else 0
        e = self.p[i] + self.estimate_off[i]
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 12, armed, main << 16 | sub << 24, 4, 3),
            mavlink.MAVLink_extended_sys_state_message(0, 1 if self.landed[i] else 2),
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, self.battery[i], 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_local_position_ned_message(0, *e.tolist(), 0.0, 0.0, 0.0),
        ):
            self.core.on_datagram(i, self._codecs[i].pack(message), self.now)

    def say(self, i: int, message: Any) -> None:
        self.core.on_datagram(i, self._codecs[i].pack(message), self.now)

    def _note(self, output: Output) -> None:
        self.events += output.events
        for row, frames in output.frames:
            for frame in frames:
                self.sent.append((self.now, row, self._ear.decode(bytearray(frame))))


def _word(m: Any) -> str:
    if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return "terminate"
    if m.command != mavlink.MAV_CMD_DO_SET_MODE:
        return ""
    return {(4.0, 3.0): "AUTO.LOITER", (4.0, 6.0): "AUTO.LAND"}[m.param2, m.param3]


def tilted(degrees: float) -> tuple[float, float, float, float]:
    """About the body's right axis: nose up."""
    half = math.radians(degrees) / 2.0
    return math.cos(half), 0.0, math.sin(half), 0.0
