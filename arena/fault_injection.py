"""Faults on purpose: how a scenario spoils a simulated arena while it flies. One local datagram is one fault, a JSON object.

Each room that can be spoiled (the world, the motion capture, the router) listens on `<path>`, a socket in the run's private
folder, and looks at it before every step, frame or turn. A sender that is awake on a lockstep clock finds its fault in force at
the next of these: time has not moved meanwhile. Arenas with real vehicles have no such sockets: their slices name none.

    world    {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}     share of the thrust that rotor 1.. still gives
             {"do": "battery", "vehicle": "uav1", "empty_in_s": 20.0}          the pace, full to empty; null: as its motors draw
             {"do": "wind", "wind_m_s": [3, 0, 0]}                             [NED]
             {"do": "sticks", "vehicle": "uav1", "on": false}                  a pilot's radio
    mocap    {"do": "dropout", "body": "uav1", "on": true}                     not tracked
             {"do": "freeze", "body": "uav1", "on": true}                      the last pose again and again, as if tracked
             {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 0}   every pose is off so far [NED]; zeros: as before
             {"do": "swap", "bodies": ["uav1", "uav2"], "on": true}            each gets the other's pose
             {"do": "delay", "ms": 200}                                        more latency: what has been seen leaves later
    router   {"do": "loss", "vehicle": "uav1", "share": 0.3}                   of the datagrams of its link, each way
             {"do": "delay", "vehicle": "uav1", "ms": 200}                     each way, in simulated time
             {"do": "heartbeat", "on": false}                                  of the ground station

A delay keeps the order. When it shrinks, what has waited long enough for the new one leaves at once. Each fault is told as an
event, `fault: wind 3 0 0 m/s`; one that makes no sense is refused with one, and changes nothing.
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
_LONGEST = 4096
_MOST = 64  # at one look
_SHOWN = 60
_PATIENCE_S = 1.0


class Faults:
    """The listening side. path: None listens to nobody. Raises RunError where there can be no socket."""

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
                raise RunError(f"cannot take faults at {self._path}: {error}") from error

    def fileno(self) -> int:
        """Readable when a fault waits; -1: nobody listens."""
        return -1 if self._socket is None else self._socket.fileno()

    def take(self) -> list[Fault]:
        """What has arrived since the last call; {} for what is no fault at all. Costs one system call when there is nothing."""
        found: list[Fault] = []
        while self._socket is not None and len(found) < _MOST:
            try:
                found.append(_read(self._socket.recv(_LONGEST)))
            except BlockingIOError:
                break
        return found

    def obey(self, spoil: Callable[[Fault], str]) -> list[str]:
        """Hand over what has arrived -> an event each. spoil: does a fault and says what it is, or raises InputError."""
        return [_told(fault, spoil) for fault in self.take()]

    def close(self) -> None:
        if self._socket is not None and self._path is not None:
            self._socket.close()
            self._path.unlink(missing_ok=True)
            self._socket = None


def inject(path: str | Path, fault: Fault) -> None:
    """Raises RunError when nobody listens there, or nobody looks for a second though there is no room for more."""
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)) as sender:
        sender.settimeout(_PATIENCE_S)
        try:
            sender.connect(str(path))
            sender.send(json.dumps(fault).encode())
        except OSError as error:
            raise RunError(f"{path}: nobody takes faults there ({error.strerror or error})") from error


# -- reading a fault: each raises InputError for what is not as it should be ---------------------------------------------------


def word(fault: Fault, key: str, choices: Collection[str]) -> str:
    found = fault.get(key)
    if not isinstance(found, str) or found not in choices:
        raise _wrong(key, found, f"one of {', '.join(choices)}")
    return found


def words(fault: Fault, key: str, choices: Collection[str], count: int) -> tuple[str, ...]:
    """So many different ones."""
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
    found = fault.get(key)
    if not isinstance(found, bool):
        raise _wrong(key, found, "true or false")
    return found


def number(fault: Fault, key: str, low: float, high: float) -> float:
    found = fault.get(key)
    if not _is_number(found, low, high):
        raise _wrong(key, found, f"a number from {low:g} to {high:g}")
    return float(found)  # type: ignore[arg-type]


def whole(fault: Fault, key: str, low: int, high: int) -> int:
    found = fault.get(key)
    if not isinstance(found, int) or not _is_number(found, low, high):
        raise _wrong(key, found, f"a whole number from {low} to {high}")
    return found


def vector(fault: Fault, key: str, most: float) -> tuple[float, float, float]:
    """Three numbers, none beyond `most` either way."""
    found = fault.get(key)
    if not isinstance(found, list) or len(found) != 3 or not all(_is_number(x, -most, most) for x in found):
        raise _wrong(key, found, f"three numbers from {-most:g} to {most:g}")
    return float(found[0]), float(found[1]), float(found[2])


def plain(values: Sequence[float]) -> str:
    """Numbers as a person writes them: 3 0 -0.5."""
    return " ".join(f"{x:g}" for x in values)


def _is_number(x: Any, low: float, high: float) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and low <= x <= high and math.isfinite(x)


def _wrong(key: str, found: Any, expected: str) -> InputError:
    return InputError(f"{key}: got {_short(found)}, expected {expected}")


def _short(x: Any) -> str:
    try:
        text = json.dumps(x)
    except RecursionError:
        text = "something deep"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _read(data: bytes) -> Fault:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _told(fault: Fault, spoil: Callable[[Fault], str]) -> str:
    if not fault:
        return "fault refused: no JSON object, or an empty one"
    try:
        return f"fault: {spoil(fault)}"
    except InputError as error:
        return f"fault refused: {_short(fault)}: {error}"
