"""Backends of a user program: the libraries that send its setpoints and commands.

The connection owns the sockets and decodes the telemetry, for all backends in the same way. A backend only turns setpoints and
commands into bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_ids import PROGRAM_COMPONENT
from arena.wire.telemetry import Telemetry

BackendName = Literal["mavlink", "mavsdk"]


@dataclass(frozen=True, kw_only=True)
class Wire:
    """Part of a vehicle's connection that a backend uses: MAVLink ids, received telemetry, functions that send.

    system_id: MAV_SYS_ID of the vehicle, and of the program.
    telemetry: received telemetry of the vehicle.
    send: function that packs a message and sends it to the vehicle.
    send_payload: function that packs an encoded payload (message id, payload) and sends it to the vehicle.
    """

    system_id: int
    telemetry: Telemetry
    send: Callable[[mavlink.MAVLink_message], None]
    send_payload: Callable[[int, bytes], None]

    @property
    def own_address(self) -> tuple[int, int]:
        """System and component id of the program."""
        return self.system_id, PROGRAM_COMPONENT

    def acknowledged(self, number: int) -> int | None:
        """Return the MAV_RESULT of a command's acknowledgement, or None before the final acknowledgement.

        number: MAV_CMD. Acknowledgements for other senders are ignored.
        """
        for ack in list(self.telemetry.acks):
            for_us = ack.command == number and ack.target == self.own_address
            if for_us and ack.result != mavlink.MAV_RESULT_IN_PROGRESS:
                return ack.result
        return None


class Command(Protocol):
    """Interface of a command to the autopilot: sends it, and returns the result of its acknowledgement."""

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send the command, or send it again.

        message: COMMAND_LONG with the number of earlier tries as `confirmation`.
        """

    def result(self) -> int | None:
        """Return the MAV_RESULT of the acknowledgement, or None before it has arrived."""


class Backend(Protocol):
    """Interface of a backend, the library that sends a user program's setpoints and commands.

    All methods except `receive` are called only inside calls of the user program.
    """

    def receive(self, datagram: bytes) -> None:
        """Process a datagram that contains messages of the vehicle."""

    def send_setpoint(self, message: mavlink.MAVLink_message) -> None:
        """Send one setpoint. When the method returns, the setpoint has been sent."""

    def command(self, number: int) -> Command:
        """Create a command to the autopilot, without sending it.

        number: MAV_CMD.
        """

    def close(self) -> None:
        """Stop the threads of the backend. No message is sent."""


class MavlinkCommand:
    """Command to the autopilot that is encoded with pymavlink. It implements `Command`."""

    def __init__(self, wire: Wire, number: int) -> None:
        self._wire, self._number = wire, number
        wire.telemetry.acks.clear()

    def send(self, message: mavlink.MAVLink_message) -> None:
        self._wire.send(message)

    def result(self) -> int | None:
        return self._wire.acknowledged(self._number)


class MavlinkBackend:
    """Backend that encodes messages with pymavlink. It implements `Backend`."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.send_setpoint = wire.send

    def receive(self, datagram: bytes) -> None:
        """Do nothing, because the connection has already decoded the datagram."""

    def command(self, number: int) -> Command:
        return MavlinkCommand(self._wire, number)

    def close(self) -> None:
        """Do nothing, because this backend has no threads."""
