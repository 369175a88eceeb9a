"""Fault injection in simulated arenas: a scenario sends faults to the sockets of running processes.

Each datagram is one JSON object.

The world, the motion capture emulator and the router can receive faults. Each has a local socket `<path>` in
the run's private folder, and reads it before every step, frame or loop cycle. On a lockstep clock, a fault
takes effect at the next of these if the sender is awake when it sends, because simulation time has not
advanced. Arenas with real vehicles have no such sockets.

    world    {"do": "motor", "vehicle": "uav1", "rotor": 1, "thrust": 0.0}     share of its thrust that rotor 1 still produces
             {"do": "battery", "vehicle": "uav1", "empty_in_s": 20.0}          discharge time from full to empty; null: by load
             {"do": "wind", "wind_m_s": [3, 0, 0]}                             wind velocity [NED]
             {"do": "sticks", "vehicle": "uav1", "on": false}                  the pilot's radio
    mocap    {"do": "dropout", "body": "uav1", "on": true}                     the body is not tracked
             {"do": "freeze", "body": "uav1", "on": true}                      the last pose is repeated, marked as tracked
             {"do": "jump", "body": "uav1", "by_m": [1, 0, 0], "yaw_deg": 0}   offset of every pose [NED]; zeros end it
             {"do": "swap", "bodies": ["uav1", "uav2"], "on": true}            each body gets the other's pose
             {"do": "delay", "ms": 200}                                        additional latency of all poses
    router   {"do": "loss", "vehicle": "uav1", "share": 0.3}                   share of lost datagrams, in each direction
             {"do": "delay", "vehicle": "uav1", "ms": 200}                     in each direction, in simulation time
             {"do": "heartbeat", "on": false}                                  heartbeat of the ground station

A delay does not change the order of datagrams. If a delay is reduced, datagrams that have already waited long
enough are sent at once. Each fault is reported as an event, `fault: wind 3 0 0 m/s`. An invalid fault is
refused with an event and changes nothing.
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
    """Socket on which a process receives injected faults, for example those of a scenario.

    path: path of the socket; None for a process without faults
    Raises RunError if the socket cannot be created.
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
        """Return a file descriptor that is readable when a fault has arrived; -1 if there is no socket."""
        return -1 if self._socket is None else self._socket.fileno()

    def take(self) -> list[Fault]:
        """Return the list of faults received since the last call.

        A datagram that is no fault gives an empty fault {}. If nothing was received, the call costs one system call.
        """
        found: list[Fault] = []
        while self._socket is not None and len(found) < _MAX_FAULTS:
            try:
                found.append(_read(self._socket.recv(_MAX_BYTES)))
            except BlockingIOError:
                break
        return found

    def apply(self, function: Callable[[Fault], str]) -> list[str]:
        """Apply all received faults. Return one line per fault for the event log.

        A line begins with `fault: ` or `fault refused: `.

        function: applies one fault and returns its description; raises InputError if the fault is invalid
        """
        return [_event(fault, function) for fault in self.take()]

    def close(self) -> None:
        if self._socket is not None and self._path is not None:
            self._socket.close()
            self._path.unlink(missing_ok=True)
            self._socket = None


def inject(path: str | Path, fault: Fault) -> None:
    """Send a fault to the socket of a running process of a simulated arena.

    path: socket on which the process receives faults

    Raises RunError if no process has this socket, or if the process reads nothing for one second.
    """
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)) as sender:
        sender.settimeout(_SEND_TIMEOUT_S)
        try:
            sender.connect(str(path))
            sender.send(json.dumps(fault).encode())
        except OSError as error:
            raise RunError(
                f"{path}: no process receives faults at this socket ({error.strerror or error})"
            ) from error


# -- reading a fault: each function raises InputError with the key, the value and what is expected


def word(fault: Fault, key: str, choices: Collection[str]) -> str:
    """Return the value of one key of a fault, after a check that the value is one of the given words.

    Raises InputError if the value is not one of `choices`.
    """
    found = fault.get(key)
    if not isinstance(found, str) or found not in choices:
        raise _wrong(key, found, f"expected one of {', '.join(choices)}")
    return found


def words(fault: Fault, key: str, choices: Collection[str], count: int) -> tuple[str, ...]:
    """Return the value of a fault's key that must be a list of words, such as the names of two axes.

    Raises InputError if the value is not a list of `count` different words of `choices`.
    """
    found = fault.get(key)
    fits = (
        isinstance(found, list)
        and len(found) == count
        and all(isinstance(x, str) and x in choices for x in found)
    )
    if not fits or len(set(found)) != count:  # type: ignore[arg-type]
        raise _wrong(key, found, f"expected a list of {count} different words out of: {', '.join(choices)}")
    return tuple(found)  # type: ignore[arg-type]


def flag(fault: Fault, key: str) -> bool:
    """Return the value of one key of a fault, after a check that the value is true or false.

    Raises InputError for another value.
    """
    found = fault.get(key)
    if not isinstance(found, bool):
        raise _wrong(key, found, "expected true or false")
    return found


def number(fault: Fault, key: str, low: float, high: float) -> float:
    """Return the value of one key of a fault, after a check that the value is a number in a range.

    Raises InputError if the value is not a finite number from `low` to `high`.
    """
    found = fault.get(key)
    if not _is_number(found, low, high):
        raise _wrong(key, found, f"expected a number from {low:g} to {high:g}")
    return float(found)  # type: ignore[arg-type]


def whole(fault: Fault, key: str, low: int, high: int) -> int:
    """Return the value of one key of a fault, after a check that the value is an integer in a range.

    Raises InputError if the value is not an integer from `low` to `high`.
    """
    found = fault.get(key)
    if not isinstance(found, int) or not _is_number(found, low, high):
        raise _wrong(key, found, f"expected an integer from {low} to {high}")
    return found


def vector(fault: Fault, key: str, most: float) -> tuple[float, float, float]:
    """Return the value of one key of a fault, after a check that the value is a vector of three numbers.

    Raises InputError if a value is not a number from -`most` to `most`.
    """
    found = fault.get(key)
    if not isinstance(found, list) or len(found) != 3 or not all(_is_number(x, -most, most) for x in found):
        raise _wrong(key, found, f"expected a list of three numbers from {-most:g} to {most:g}")
    return float(found[0]), float(found[1]), float(found[2])


def plain(values: Sequence[float]) -> str:
    """Format numbers for a message, without unnecessary digits: "3 0 -0.5"."""
    return " ".join(f"{x:g}" for x in values)


def _is_number(x: Any, low: float, high: float) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and low <= x <= high and math.isfinite(x)


def _wrong(key: str, found: Any, expected: str) -> InputError:
    return InputError(f"{key}: got {_short(found)}, {expected}")


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
