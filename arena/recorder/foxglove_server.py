"""WebSocket server that sends the recorder's messages to Foxglove during the flight.

The server runs in threads of foxglove-sdk, without Python. A client that reads slowly or not at all loses its oldest messages:
`BACKLOG_MESSAGES` wait for each client at most, and logging a message never waits for a client.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from arena.recorder.mcap_file import Log
from arena.recorder.mcap_records import SchemaData

if TYPE_CHECKING:
    from foxglove.websocket import WebSocketServer

BACKLOG_MESSAGES = 1024
_TIME_PERIOD_S = 1.0 / 30.0


class FoxgloveServer:
    """WebSocket server for Foxglove.

    failure: the reason why the server could not start, else an empty text.

    address, port: where clients connect.  name: name of the arena, shown by clients.
    simulation_clock: log times are simulation time, so that clients show this time instead of their own.
    """

    def __init__(self, address: str, port: int, name: str, *, simulation_clock: bool) -> None:
        from foxglove import Context, start_server
        from foxglove.websocket import Capability

        # foxglove-sdk logs an error for each message that waits for a client which has disconnected.
        logging.getLogger("foxglove").setLevel(logging.CRITICAL)
        self.failure = ""
        self._context = Context()  # foxglove closes the channels of a context that Python deletes
        self.address = address
        self._server: WebSocketServer | None = None
        self._sends_time, self._next_time_s = simulation_clock, float("-inf")
        try:
            self._server = start_server(
                name=name,
                host=address,
                port=port,
                context=self._context,
                capabilities=[Capability.Time] if simulation_clock else [],
                message_backlog_size=BACKLOG_MESSAGES,
            )
        except Exception as error:  # the port is in use, or the address is not one of this computer
            self.failure = f"cannot serve Foxglove at {address}:{port}: {error}"

    @property
    def port(self) -> int | None:
        """TCP port of the server, or None if the server did not start."""
        return None if self._server is None else self._server.port

    @property
    def url(self) -> str:
        """WebSocket URL to which a viewer connects."""
        return f"ws://{self.address}:{self.port}"

    def channel(self, topic: str, encoding: str, schema: SchemaData, log: Log) -> Log:
        """Create a channel for viewers. Return a function that sends a message to them and to the record.

        log: function that sends a message to the record
        """
        from foxglove import Channel, Schema

        described = Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
        # `Channel.log` converts other types to bytes, and needs twice the time of `BaseChannel.log`, which takes bytes.
        send = Channel(topic, message_encoding=encoding, schema=described, context=self._context).base.log

        def log_both(data: bytes, log_time: int) -> None:
            log(data, log_time)
            send(data, log_time)

        return log_both

    def pass_time(self, time_s: float) -> None:
        """Send the simulation time to the viewers, at most 30 times per second.

        time_s: present time of the run's clock [s].
        """
        if self._server is None or not self._sends_time or time_s < self._next_time_s:
            return
        self._next_time_s = time_s + _TIME_PERIOD_S
        self._server.broadcast_time(max(0, round(time_s * 1e9)))

    def close(self) -> None:
        """End the server and all connections."""
        if self._server is not None:
            self._server.stop()
            self._server = None
