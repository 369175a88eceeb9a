"""Encoder and decoder for MAVLink's parameter messages, with integers as PX4 encodes them. Pure.

    PARAM_REQUEST_READ (20)   <h B B 16s     index (-1: by name), system, component, name
    PARAM_REQUEST_LIST (21)   <B B           system, component
    PARAM_VALUE (22)          <4s H H 16s B  value, count, index, name, type
    PARAM_SET (23)            <4s B B 16s B  value, system, component, name, type
    PARAM_ERROR (345)         <h B B 16s B   index, system, component, name, error
    COMMAND_LONG (76)         <7f H B B B    parameters, command, system, component, confirmation

The four bytes of a value are a float, or the bytes of an integer. An integer must never be copied as a float,
because some integers are the bit pattern of a signalling NaN, which a copy would change.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame
from arena.wire.mavlink_minimal import AUTOPILOT_VERSION, REQUEST_MESSAGE, SYSTEM_TIME
from arena.wire.qgc_params import INTEGERS

REQUEST_READ, REQUEST_LIST, VALUE, SET, COMMAND_LONG, ERROR = 20, 21, 22, 23, 76, 345
REBOOT = 246
HASH = "_HASH_CHECK"
NO_INDEX = 65535
"""Index of a parameter that exists but is not in PX4's list, because no module uses it yet."""
DOES_NOT_EXIST = 1
NAME_BYTES = 16

_READ, _LIST, _VALUE, _SET, _ERROR, _COMMAND = (
    struct.Struct(s) for s in ("<hBB16s", "<BB", "<4sHH16sB", "<4sBB16sB", "<hBB16sB", "<7fHBBB")
)
_WIDTH = {1: 1, 2: 1, 3: 2, 4: 2}  # MAV_PARAM_TYPE -> bytes; 4 for the others. Odd integer types are unsigned
_TYPE_NAMES = {
    1: "UINT8",
    2: "INT8",
    3: "UINT16",
    4: "INT16",
    5: "UINT32",
    6: "INT32",
    7: "UINT64",
    8: "INT64",
}
_SAME = 1e-6
_ERRORS = {
    1: "it does not exist",
    2: "the value is out of range",
    3: "permission is denied",
    4: "the component is not found",
    5: "it is read-only",
    6: "the type is not supported",
    7: "the type is different",
    8: "it could not be read",
}

Message = tuple[int, bytes]
"""A message that is not packed into a frame yet: (message id, payload)."""


class Value(NamedTuple):
    """Contents of PARAM_VALUE, the message in which an autopilot reports one parameter.

    value: an int for an integer type
    kind: MAV_PARAM_TYPE
    place: index in the vehicle's list, or NO_INDEX
    total: length of the list
    """

    name: str
    value: float
    kind: int
    place: int
    total: int


def parse_value(data: Buffer, frame: Frame) -> Value:
    """Decode PARAM_VALUE, the message in which an autopilot reports one parameter."""
    raw, count, index, name, kind = _VALUE.unpack(_payload(data, frame, _VALUE.size))
    return Value(_text(name), _from_bytes(raw, kind), kind, index, count)


def parse_error(data: Buffer, frame: Frame) -> tuple[str, int, str]:
    """Decode PARAM_ERROR, the refusal to read or set a parameter. Return (name, error number, text)."""
    *_, name, error = _ERROR.unpack(_payload(data, frame, _ERROR.size))
    return _text(name), error, _ERRORS.get(error, f"error {error}")


def request_list(system: int) -> Message:
    return REQUEST_LIST, _LIST.pack(system, AUTOPILOT)


def request_read(system: int, what: str | int) -> Message:
    """Return PARAM_REQUEST_READ, the request for the value of one parameter.

    what: name of the parameter, or its index in the list.
    """
    if isinstance(what, int):
        return REQUEST_READ, _READ.pack(what, system, AUTOPILOT, b"")
    return REQUEST_READ, _READ.pack(-1, system, AUTOPILOT, what.encode())


def parse_requested(data: Buffer, frame: Frame) -> tuple[int, str]:
    """Decode PARAM_REQUEST_READ. Return (index in the list or -1, name)."""
    index, _, _, name = _READ.unpack(_payload(data, frame, _READ.size))
    return index, _text(name)


def parse_set_name(data: Buffer, frame: Frame) -> str:
    """Return the name of the parameter that PARAM_SET changes."""
    return _text(_SET.unpack(_payload(data, frame, _SET.size))[3])


def value_message(value: Value) -> Message:
    """Return PARAM_VALUE, the message in which an autopilot reports one parameter."""
    raw, name = _to_bytes(value.value, value.kind), value.name.encode()
    return VALUE, _VALUE.pack(raw, value.total, value.place, name, value.kind)


def set_value(system: int, name: str, value: float, kind: int) -> Message:
    """Return PARAM_SET, the request to change one parameter.

    value: as returned by `fitted`.
    kind: MAV_PARAM_TYPE.
    """
    return SET, _SET.pack(_to_bytes(value, kind), system, AUTOPILOT, name.encode(), kind)


def reboot(system: int) -> Message:
    """Return a command that reboots the autopilot: MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN."""
    return COMMAND_LONG, _COMMAND.pack(1.0, *(0.0,) * 6, REBOOT, system, AUTOPILOT, 0)


def request_uid(system: int) -> Message:
    """Return a command that requests AUTOPILOT_VERSION, which contains the hardware uid: MAV_CMD_REQUEST_MESSAGE."""
    return _request_message(system, AUTOPILOT_VERSION)


def request_boot_time(system: int) -> Message:
    """Return a command that requests SYSTEM_TIME, which contains the time since the boot: MAV_CMD_REQUEST_MESSAGE."""
    return _request_message(system, SYSTEM_TIME)


def _request_message(system: int, msgid: int) -> Message:
    params = (float(msgid), *(0.0,) * 6)
    return COMMAND_LONG, _COMMAND.pack(*params, REQUEST_MESSAGE, system, AUTOPILOT, 0)


def fitted(value: float, kind: int) -> float:
    """Convert a value to the parameter's type (MAV_PARAM_TYPE), as the autopilot stores it.

    Raises ValueError with the reason if the type cannot store the value.
    """
    if not math.isfinite(value):
        raise ValueError(f"got {value}, expected a finite number")
    if kind in INTEGERS and value != int(value):
        raise ValueError(f"got {value:.9g}, expected an integer")
    try:
        return _from_bytes(_to_bytes(value, kind), kind)
    except (OverflowError, struct.error):
        type_name = _TYPE_NAMES.get(kind, "REAL32")
        raise ValueError(
            f"got {value:.9g}, too large or too small for the parameter's type {type_name}"
        ) from None


def alike(a: float, b: float, kind: int) -> bool:
    """Return whether two values of a parameter are equal, apart from rounding in a .params file.

    Floats are equal if they agree in all digits that a .params file contains.
    """
    return a == b if kind in INTEGERS else math.isclose(a, b, rel_tol=_SAME)


def is_name(name: str) -> bool:
    """Return whether a text is valid as a parameter name: 1 to 16 printable ASCII characters.

    `_HASH_CHECK` is not valid, because it is not a parameter.
    """
    return 0 < len(name) <= NAME_BYTES and name.isascii() and name.isprintable() and name != HASH


def _to_bytes(value: float, kind: int) -> bytes:
    if kind not in INTEGERS:
        return struct.pack("<f", value)
    width = _WIDTH.get(kind, 4)
    return int(value).to_bytes(width, "little", signed=kind % 2 == 0).ljust(4, b"\0")


def _from_bytes(raw: bytes, kind: int) -> float:
    if kind in INTEGERS:
        return int.from_bytes(raw[: _WIDTH.get(kind, 4)], "little", signed=kind % 2 == 0)
    return float(struct.unpack("<f", raw)[0])


def _payload(data: Buffer, frame: Frame, size: int) -> bytes:
    """Return `size` bytes of a payload: zeros replace bytes that MAVLink 2 has truncated, fields of later versions are removed."""
    return bytes(data[frame.payload : frame.payload + min(frame.size, size)]).ljust(size, b"\0")


def _text(name: bytes) -> str:
    return name.split(b"\0")[0].decode(errors="replace")
