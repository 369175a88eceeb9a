"""Messages from the link process itself to the vehicle: heartbeats and requests. Pure.

Parameters, streams, clock and hardware uid are requested.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.axes_check import IMU_HZ, AxesCheck
from arena.fcu_link.identity import Identity, uid_request
from arena.fcu_link.param_check import ParamCheck
from arena.fcu_link.stream_requests import StreamRequests
from arena.transport import Source
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT

_HEARTBEAT_S = 1.0


class OwnRequests:
    """Source of the heartbeats and requests that the link process itself sends to the vehicle.

    Call `due` about twenty times a second and send the messages that it returns.

    codec: encodes these messages, with the component id of the link process as the sender
    """

    def __init__(
        self,
        system: int,
        codec: Codec,
        identity: Identity,
        params: ParamCheck,
        streams: StreamRequests,
        axes: AxesCheck,
    ) -> None:
        self._system, self._codec = system, codec
        self._identity, self._params, self._streams, self._axes = identity, params, streams, axes
        self._heartbeat_at = -math.inf

    def due(self, now: float, *, connected: bool) -> Iterator[tuple[int, bytes]]:
        """Yield message id and frame of each heartbeat or request to send to the vehicle now.

        connected: the vehicle is identified and has sent data recently.
        """
        unknown = self._identity.source is None and self._identity.has_candidate(now)
        if now - self._heartbeat_at >= _HEARTBEAT_S and not unknown:
            self._heartbeat_at = now
            yield mavlink.MAVLINK_MSG_ID_HEARTBEAT, self._codec.onboard_heartbeat()
        for message in self._requests(now) if connected else ():
            yield message.get_msgId(), self._codec.pack(message)

    def uid_requests(self, now: float) -> list[tuple[Source, bytes]]:
        """Return the requests for the hardware uid to send now, as (receiver, frame).

        receiver: UDP address or serial device
        """
        return [
            (source, self._codec.pack(uid_request(self._system, command)))
            for source, command in self._identity.requests(now)
        ]

    def _requests(self, now: float) -> Iterator[Any]:
        self._streams.set_rate(mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, IMU_HZ if self._axes.running else None)
        for name in self._params.due(now):
            yield mavlink.MAVLink_param_request_read_message(self._system, AUTOPILOT, name.encode(), -1)
        if (wanted := self._streams.due(now)) is not None:
            number = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            yield mavlink.MAVLink_command_long_message(
                self._system, AUTOPILOT, number, 0, float(wanted[0]), wanted[1], 0, 0, 0, 0, 0
            )
        yield from self._axes.due(now)
