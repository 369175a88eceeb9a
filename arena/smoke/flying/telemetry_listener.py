"""What each vehicle says of itself, heard on its tools port as any other tool would. It asks for messages, and commands nothing
unless told to.

HEARTBEAT's rate cannot be changed, so each one is asked for; the other rates live in the autopilot, and are asked for again
whenever they do not hold.
"""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.plan.model import VehiclePlan
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry

SYSTEM = 250
_US = 50_000  # between two of each of _ASKED
_ASKED = (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED)
HEARD = {
    *_ASKED,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
}
_BEAT_S = 0.04  # simulation time between two HEARTBEATs asked for: every second look
_SILENT_S, _AGAIN_S = 0.25, 0.2  # simulation time without an answer, and between two requests for rates
_BEHIND_S = 0.1  # simulation time that a vehicle's word may lag behind while time waits for it
_LONGEST_WAIT_S = 0.03  # wall time
_DATAGRAM_BYTES = 1 << 16


class TelemetryListener:
    """Of one referee. vehicles: of a running plan. Time is simulation time [s] but where it says wall."""

    def __init__(self, vehicles: Sequence[VehiclePlan]) -> None:
        self.told: Mapping[str, Telemetry] = {v.name: Telemetry(v.id, HEARD) for v in vehicles}
        self._codec = Codec(SYSTEM, 190 + os.getpid() % 60)
        self._vehicles = {v.name: v for v in vehicles}
        self._sockets = {v.name: _open(v) for v in vehicles}
        self._next_beat = dict.fromkeys(self._sockets, float("-inf"))
        self._next_rates = dict(self._next_beat)
        self._prompt: set[str] = set()  # those worth waiting for

    def listen(self, now: float) -> None:
        """Take what has arrived, wait a little for those whose last word is old, and ask where something is missing."""
        self._drain(now)
        deadline = time.monotonic() + _LONGEST_WAIT_S
        while (late := [name for name in self._prompt if self._behind(name, now)]) and (
            left := deadline - time.monotonic()
        ) > 0:
            select.select([self._sockets[name] for name in late], [], [], left)
            self._drain(now)
        self._prompt = {name for name in self.told if not self._behind(name, now)}
        for name in self.told:
            self._ask(name, now)

    def command(self, vehicle: str, number: int, *params: float) -> None:
        """One COMMAND_LONG. Nobody waits for its acknowledgement: whether it did anything is what a scenario looks at."""
        seven = [*params, *[0.0] * 7][:7]
        self._send(
            vehicle, mavlink.MAVLink_command_long_message(self._vehicles[vehicle].id, 1, number, 0, *seven)
        )

    def set_parameter(self, vehicle: str, name: str, value: float) -> None:
        """A parameter that is a float."""
        self._send(
            vehicle,
            mavlink.MAVLink_param_set_message(
                self._vehicles[vehicle].id, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
            ),
        )

    def close(self) -> None:
        for sock in self._sockets.values():
            sock.close()

    def _drain(self, now: float) -> None:
        for name, sock in self._sockets.items():
            while True:
                try:
                    self.told[name].hear(sock.recv(_DATAGRAM_BYTES), now)
                except OSError:  # nothing there, or nobody: a router that is not up refuses
                    break

    def _behind(self, name: str, now: float) -> bool:
        """By the autopilot's own time, which is that of the world: a busy machine carries words late."""
        local = self.told[name].local
        return local is None or now - local.boot_s > _BEHIND_S

    def _ask(self, name: str, now: float) -> None:
        if now >= self._next_beat[name] - 1e-6:
            self._next_beat[name] = now + _BEAT_S
            self.command(name, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        ground = self.told[name].ground
        if (ground is None or now - ground.heard > _SILENT_S) and now >= self._next_rates[name]:
            self._next_rates[name] = now + _AGAIN_S
            for message in _ASKED:
                self.command(name, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, _US)

    def _send(self, vehicle: str, message: Any) -> None:
        try:
            self._sockets[vehicle].send(self._codec.pack(message))
        except OSError:  # the router is not there
            return


def _open(vehicle: VehiclePlan) -> socket.socket:
    """Connected to the router's tools port, so that nobody else is heard."""
    sock = open_udp((vehicle.router.partner_host, 0))
    sock.connect((vehicle.router.partner_host, vehicle.tools_port))
    return sock
