"""Receiver of each vehicle's telemetry, for the referee that judges a smoke flight.

The telemetry comes from each vehicle's tools port: a UDP port of the router that replies to any program on this computer.

The listener requests messages, but sends no commands to the vehicles unless the scenario requires one. The rate of
HEARTBEAT cannot be configured, so each HEARTBEAT is requested. The rates of the other messages are set in the autopilot,
and set again if the messages do not arrive.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.plan.model import VehiclePlan
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import REFEREE
from arena.wire.telemetry import Telemetry

_INTERVAL_US = 50_000  # of each message in _REQUESTED
_REQUESTED = (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED)
RECEIVED = {
    *_REQUESTED,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
}
_HEARTBEAT_PERIOD_S = 0.04  # simulation time between requests: every second observation
_MISSING_S = 0.25  # simulation time without EXTENDED_SYS_STATE after which rates are requested
_RETRY_S = 0.2  # simulation time between these requests
_LATE_S = 0.1  # simulation time: the listener waits for telemetry that is older than this
_MAX_WAIT_S = 0.03  # wall time
_DATAGRAM_BYTES = 1 << 16


class TelemetryListener:
    """Receiver of the telemetry of all vehicles. All times are simulation time [s].

    vehicles: vehicles of the running plan.  telemetry: vehicle -> newest telemetry.
    """

    def __init__(self, vehicles: Sequence[VehiclePlan]) -> None:
        self.telemetry: Mapping[str, Telemetry] = {v.name: Telemetry(v.id, RECEIVED) for v in vehicles}
        self._codec = Codec(REFEREE.system, REFEREE.component)
        self._vehicles = {v.name: v for v in vehicles}
        self._sockets = {v.name: _open(v) for v in vehicles}
        self._next_heartbeat = dict.fromkeys(self._sockets, float("-inf"))
        self._next_rates = dict(self._next_heartbeat)
        self._prompt: set[str] = (
            set()
        )  # vehicles whose last telemetry was in time; `listen` waits for these only

    def listen(self, now: float) -> None:
        """Receive telemetry and request missing messages. Wait up to _MAX_WAIT_S for late telemetry."""
        self._drain(now)
        deadline = time.monotonic() + _MAX_WAIT_S
        while (late := [name for name in self._prompt if self._is_late(name, now)]) and (
            left := deadline - time.monotonic()
        ) > 0:
            select.select([self._sockets[name] for name in late], [], [], left)
            self._drain(now)
        self._prompt = {name for name in self.telemetry if not self._is_late(name, now)}
        for name in self.telemetry:
            self._ask(name, now)

    def command(self, vehicle: str, number: int, *params: float) -> None:
        """Send one COMMAND_LONG without waiting for COMMAND_ACK.

        number: MAV_CMD.
        params: up to 7 parameters.
        """
        seven = [*params, *[0.0] * 7][:7]
        self._send(
            vehicle, mavlink.MAVLink_command_long_message(self._vehicles[vehicle].id, 1, number, 0, *seven)
        )

    def set_parameter(self, vehicle: str, name: str, value: float) -> None:
        """Send PARAM_SET for a parameter of type float."""
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
                    self.telemetry[name].on_datagram(sock.recv(_DATAGRAM_BYTES), now)
                except OSError:  # nothing received, or no router that listens
                    break

    def _is_late(self, name: str, now: float) -> bool:
        """Return whether the newest position of a vehicle is missing or older than _LATE_S.

        The age is counted from the autopilot's time stamp.
        """
        local = self.telemetry[name].local
        return local is None or now - local.boot_s > _LATE_S

    def _ask(self, name: str, now: float) -> None:
        if now >= self._next_heartbeat[name] - 1e-6:
            self._next_heartbeat[name] = now + _HEARTBEAT_PERIOD_S
            self.command(name, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        ground = self.telemetry[name].ground
        if (ground is None or now - ground.received_at > _MISSING_S) and now >= self._next_rates[name]:
            self._next_rates[name] = now + _RETRY_S
            for message in _REQUESTED:
                self.command(name, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, _INTERVAL_US)

    def _send(self, vehicle: str, message: Any) -> None:
        try:
            self._sockets[vehicle].send(self._codec.pack(message))
        except OSError:  # no router listens
            return


def _open(vehicle: VehiclePlan) -> socket.socket:
    """Return a UDP socket that is connected to the tools port of a vehicle.

    A connected socket receives datagrams from this port only.
    """
    sock = open_udp((vehicle.router.partner_host, 0))
    sock.connect((vehicle.router.partner_host, vehicle.tools_port))
    return sock
