"""Faults that a scenario injects into a simulated arena while it flies. One datagram on a local socket is one fault, a JSON object.

Each process that can have faults (the world, the motion capture emulator, the router) receives them on `<path>`, a socket in the
run's private folder, and reads it before every step, frame or turn. On a lockstep clock, a fault that is sent while the sender is
awake is active at the next of these, because simulation time has not moved. Arenas with real vehicles have no such sockets: their
slices name none.

    world    {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}     share of its thrust that the rotor (1..) still gives
             {"do": "battery", "vehicle": "uav1", "empty_in_s": 20.0}          discharge time from full to empty; null: by load
             {"do": "wind", "wind_m_s": [3, 0, 0]}                             [NED]
             {"do": "sticks", "vehicle": "uav1", "on": false}                  the pilot's radio
    mocap    {"do": "dropout", "body": "uav1", "on": true}                     the body is not tracked
             {"do": "freeze", "body": "uav1", "on": true}                      the last pose is repeated, marked as tracked
             {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 0}   offset of every pose [NED]; zeros end it
             {"do": "swap", "bodies": ["uav1", "uav2"], "on": true}            each body gets the other's pose
             {"do": "delay", "ms": 200}                                        additional latency of all poses
    router   {"do": "loss", "vehicle": "uav1", "share": 0.3}                   of its link's datagrams, in each direction
             {"do": "delay", "vehicle": "uav1", "ms": 200}                     in each direction, in simulation time
             {"do": "heartbeat", "on": false}                                  the ground station's

A delay keeps the order. When it shrinks, what has waited long enough leaves at once. Each fault is reported as an event,
`fault: wind 3 0 0 m/s`; an invalid one is refused with an event and changes nothing.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from arena.errors import InputError, RunError

Fault = dict[str, Any]
_MAX_BYTES = 4096
_MAX_FAULTS = 64  # of one call of `take`
_MAX_SHOWN = 60  # characters
_SEND_TIMEOUT_S = 1.0


class FaultReceiver:
    """The socket that a process receives faults on.

    path: of the socket; None for a process without faults
    Raises RunError when the socket cannot be made.
    """

    def __init__(self, path: str | Path | None) -> None:
        self._path = Path(path) if path else None
        self._socket: socket.socket | None = None
        if self._path is not None:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            try:
                self._path.unlink(missing_ok=True)
                self._socket.bind(str(self._path))
                self._path.chmod(0o600)
            except OSError as error:
                self._socket.close()
                raise RunError(f"cannot receive faults at {self._path}: {error}") from error

    def fileno(self) -> int:
        """Return the file descriptor, readable when a fault waits; -1 without a socket."""
        return -1 if self._socket is None else self._socket.fileno()

    def take(self) -> list[Fault]:
        """Return the faults since the last call, {} for a datagram that is not a fault. Costs one system call when there is none."""
        found: list[Fault] = []
        while self._socket is not None and len(found) < _MAX_FAULTS:
            try:
                found.append(_read(self._socket.recv(_MAX_BYTES)))
            except BlockingIOError:
                break
        return found

    def apply(self, function: Callable[[Fault], str]) -> list[str]:
        """Pass each received fault to `function` and return an event for each.

        function: applies a fault and returns it in words, or raises InputError
        """
        return [_event(fault, function) for fault in self.take()]

    def close(self) -> None:
        if self._socket is not None and self._path is not None:
            self._socket.close()
            self._path.unlink(missing_ok=True)
            self._socket = None


def inject(path: str | Path, fault: Fault) -> None:
    """Send a fault. Raises RunError when no process receives faults there, or it has read none for a second."""
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)) as sender:
        sender.settimeout(_SEND_TIMEOUT_S)
        try:
            sender.connect(str(path))
            sender.send(json.dumps(fault).encode())
        except OSError as error:
            raise RunError(f"{path}: no process receives faults there ({error.strerror or error})") from error


# -- reading a fault: each function raises InputError with the key, the value and what is expected


def word(fault: Fault, key: str, choices: Collection[str]) -> str:
    """Return one word of `choices`."""
    found = fault.get(key)
    if not isinstance(found, str) or found not in choices:
        raise _wrong(key, found, f"one of {', '.join(choices)}")
    return found


def words(fault: Fault, key: str, choices: Collection[str], count: int) -> tuple[str, ...]:
    """Return `count` different words of `choices`."""
    found = fault.get(key)
    fits = (
        isinstance(found, list)
        and len(found) == count
        and all(isinstance(x, str) and x in choices for x in found)
    )
    if not fits or len(set(found)) != count:  # type: ignore[arg-type]
        raise _wrong(key, found, f"{count} different ones of {', '.join(choices)}")
    return tuple(found)  # type: ignore[arg-type]


def flag(fault: Fault, key: str) -> bool:
    """Return true or false."""
    found = fault.get(key)
    if not isinstance(found, bool):
        raise _wrong(key, found, "true or false")
    return found


def number(fault: Fault, key: str, low: float, high: float) -> float:
    """Return a finite number from `low` to `high`."""
    found = fault.get(key)
    if not _is_number(found, low, high):
        raise _wrong(key, found, f"a number from {low:g} to {high:g}")
    return float(found)  # type: ignore[arg-type]


def whole(fault: Fault, key: str, low: int, high: int) -> int:
    """Return a whole number from `low` to `high`."""
    found = fault.get(key)
    if not isinstance(found, int) or not _is_number(found, low, high):
        raise _wrong(key, found, f"a whole number from {low} to {high}")
    return found


def vector(fault: Fault, key: str, most: float) -> tuple[float, float, float]:
    """Return three numbers between -most and most."""
    found = fault.get(key)
    if not isinstance(found, list) or len(found) != 3 or not all(_is_number(x, -most, most) for x in found):
        raise _wrong(key, found, f"three numbers from {-most:g} to {most:g}")
    return float(found[0]), float(found[1]), float(found[2])


def plain(values: Sequence[float]) -> str:
    """Return numbers as a person writes them: 3 0 -0.5."""
    return " ".join(f"{x:g}" for x in values)


def _is_number(x: Any, low: float, high: float) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and low <= x <= high and math.isfinite(x)


def _wrong(key: str, found: Any, expected: str) -> InputError:
    return InputError(f"{key}: got {_short(found)}, expected {expected}")


def _short(x: Any) -> str:
    try:
        text = json.dumps(x)
    except RecursionError:
        text = "a deeply nested value"
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def _read(data: bytes) -> Fault:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _event(fault: Fault, function: Callable[[Fault], str]) -> str:
    if not fault:
        return "fault refused: not a JSON object, or an empty one"
    try:
        return f"fault: {function(fault)}"
    except InputError as error:
        return f"fault refused: {_short(fault)}: {error}"
