"""Reads parameters of a running vehicle over MAVLink, through the router's UDP port for tools.

No parameter is written.
"""

from __future__ import annotations

import contextlib
import select
import struct
import time
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from arena.errors import RunError
from arena.fly.running_vehicle import RunningVehicle
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import FLIGHT_TOOL

_TIMEOUT_S, _RETRY_S = 10.0, 0.5


def read_parameters(vehicle: RunningVehicle, names: Sequence[str]) -> dict[str, float]:
    """Request parameters of a vehicle over MAVLink, and return {parameter name: value}.

    Raises RunError if the vehicle does not report all of them within 10 s.
    """
    assert vehicle.settings.tools is not None
    codec, found = Codec(FLIGHT_TOOL.system, FLIGHT_TOOL.component), dict[str, float]()
    with contextlib.closing(open_udp((vehicle.settings.tools[0], 0))) as sock:
        sock.connect(vehicle.settings.tools)
        end, next_try = time.monotonic() + _TIMEOUT_S, 0.0
        while missing := [name for name in names if name not in found]:
            now = time.monotonic()
            if now > end:
                raise RunError(
                    f"{vehicle.name}: no reply within {_TIMEOUT_S:g} s to the request for {', '.join(missing)}"
                )
            if now >= next_try:
                next_try = now + _RETRY_S
                for name in missing:
                    request = mavlink.MAVLink_param_request_read_message(
                        vehicle.settings.id, 1, name.encode(), -1
                    )
                    with contextlib.suppress(OSError):
                        sock.send(codec.pack(request))
            select.select([sock], [], [], 0.05)
            with contextlib.suppress(OSError):
                while True:
                    for m in codec.parse(sock.recv(1 << 16), {mavlink.MAVLINK_MSG_ID_PARAM_VALUE}):
                        if m.get_srcSystem() == vehicle.settings.id:
                            found[m.param_id] = parameter_value(m.param_value, m.param_type)
    return found


def parameter_value(value: float, kind: int) -> float:
    """Decode the value of a PARAM_VALUE message, in which an INT32 is sent as the four bytes of a float.

    kind: MAV_PARAM_TYPE.
    """
    if kind == mavlink.MAV_PARAM_TYPE_INT32:
        return float(int.from_bytes(struct.pack("<f", value), "little", signed=True))
    return value
