"""Check of the request `replay`, which pauses a replayed record, sets its speed or jumps to a time. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from arena.plan.model import Plan

KEYS = ("pause", "seek_s", "speed")
_MAX_SPEED = 1000.0


def replay_packet(plan: Plan, request: Mapping[str, Any]) -> tuple[list[str], dict[str, Any]]:
    """Convert a `replay` request to a packet. Return the names of the processes that get it, and the packet.

    request: request of the control socket. `pause`: true or false. `seek_s`: place in the record, after its start [s].
        `speed`: recorded seconds per second of wall time, or "max". Keys that are missing change nothing.
    Raises ValueError if the arena is no replay, or if a value is wrong.
    """
    if not plan.is_replay:
        raise ValueError(
            f"{plan.name} is not a replay: pause, seek_s and speed are for the replay of a record"
        )
    packet = {key: request[key] for key in KEYS if request.get(key) is not None}
    if not packet:
        raise ValueError(f"nothing to change: expected at least one of {', '.join(KEYS)}")
    if not isinstance(packet.get("pause", False), bool):
        raise ValueError(f"pause: got {packet['pause']!r}, expected true or false")
    if not _is_number(packet.get("seek_s", 0.0)):
        raise ValueError(f"seek_s: got {packet['seek_s']!r}, expected seconds after the start of the record")
    speed = packet.get("speed", "max")
    if speed != "max" and not (_is_number(speed) and 0.0 < speed <= _MAX_SPEED):
        raise ValueError(
            f"speed: got {speed!r}, expected a number above 0 and at most {_MAX_SPEED:g}, or max"
        )
    return [spec.name for spec in plan.processes if spec.kind == "replay"], {"do": "replay", **packet}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
