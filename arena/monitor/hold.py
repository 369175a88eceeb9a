"""Process of the button HOLD: commands AUTO.LOITER, and waits until each vehicle reports this mode.

    python -m arena.monitor.hold --run DIR uav1 uav2

HOLD is the command of a ground station (docs/explanation/authority.md). If it ends OFFBOARD, programs cannot fly the vehicle again
before `arena release`. In another mode it takes control from no program, and the result says so. The command goes through the
router, which refuses it after `arena land-all`. A vehicle in a manual mode belongs to its pilot, so HOLD does not command it.
"""

from __future__ import annotations

import argparse
import select
import socket
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import common as mavlink

from arena.emergency.targets import Target, choose, find
from arena.errors import EXIT_FAILED, EXIT_OK, ArenaError
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import HOLD
from arena.wire.mavlink_minimal import result_words
from arena.wire.px4_mode import MANUAL_MODES
from arena.wire.telemetry import Telemetry

MODE, OFFBOARD = "AUTO.LOITER", "OFFBOARD"
_MAIN_AND_SUB = (4.0, 3.0)
TIMEOUT_S = 5.0
RETRY_S = 0.5
_MODE_ENABLED = 1.0  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_RECEIVED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}


class Hold:
    """Hold command to one vehicle, without sockets: returns the frames to send and the result. Pure.

    now: monotonic [s]. signs: the vehicle has a signing key.
    """

    def __init__(self, name: str, system: int, now: float, *, simulated: bool, signs: bool = False) -> None:
        self.name, self._system, self._simulated = name, system, simulated
        self._codec = Codec(HOLD.system, HOLD.component_at(signs=signs))
        self._telemetry = Telemetry(system, _RECEIVED)
        self._began, self._next_send = now, now
        self._commanded_in = ""  # mode of the vehicle when it was commanded first
        self.result = ""
        self.confirmed = False

    def on_datagram(self, data: bytes, now: float) -> None:
        """Update the result from a telemetry datagram of the vehicle."""
        self._telemetry.on_datagram(data, now)
        state = self._telemetry.heartbeat
        if state is None or self.result:
            return
        if not state.armed:
            self._end("NOT CONFIRMED: the vehicle is disarmed, so there is nothing to hold")
        elif state.mode in MANUAL_MODES and not self._simulated:
            self._end(f"NOT CONFIRMED: pilot has control ({state.mode})")
        elif state.mode == MODE and self._commanded_in:
            self.confirmed = True
            self._end(f"holds its position ({MODE}) after {now - self._began:.1f} s{self._warning()}")
        elif (refusal := self._refusal()) is not None:
            self._end(f"NOT CONFIRMED: {refusal}")

    def due(self, now: float) -> list[bytes]:
        """Return the MAVLink frames of the HOLD command to send now.

        After TIMEOUT_S without a confirmation of the vehicle, return none and set the result to NOT CONFIRMED.
        """
        if self.result:
            return []
        state = self._telemetry.heartbeat
        if now - self._began >= TIMEOUT_S:
            last = "no heartbeat" if state is None else f"still in {state.mode}"
            self._end(f"NOT CONFIRMED: {last} after {TIMEOUT_S:g} s")
            return []
        if now < self._next_send:
            return []
        self._next_send = now + RETRY_S
        request = self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, float(mavlink.MAVLINK_MSG_ID_HEARTBEAT))
        if state is None:  # the mode decides whether the vehicle may be commanded
            return [request]
        self._commanded_in = self._commanded_in or state.mode
        return [self._command(mavlink.MAV_CMD_DO_SET_MODE, _MODE_ENABLED, *_MAIN_AND_SUB), request]

    def _warning(self) -> str:
        """Return a warning if a program may take the vehicle out of hold again, else "".

        This is possible if the vehicle was not in OFFBOARD when the command was sent.
        """
        if self._commanded_in == OFFBOARD:
            return ""
        return f", but a program may take it to {OFFBOARD}, because it was in {self._commanded_in}. LAND prevents this"

    def _refusal(self) -> str | None:
        """Return why the vehicle or the router has refused the mode; None without a refusal."""
        for ack in self._telemetry.acks:
            refused = ack.result not in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)
            if ack.command == mavlink.MAV_CMD_DO_SET_MODE and refused:
                texts = self._telemetry.recent_texts(self._began, mavlink.MAV_SEVERITY_WARNING)
                return f"refused ({result_words(ack.result)}){': ' + texts[-1] if texts else ''}"
        return None

    def _command(self, number: int, *params: float) -> bytes:
        seven = [*params, *[0.0] * 7][:7]
        return self._codec.pack(mavlink.MAVLink_command_long_message(self._system, 1, number, 0, *seven))

    def _end(self, text: str) -> None:
        self.result = f"{self.name}: {text}"


def hold(targets: tuple[Target, ...]) -> int:
    """Command vehicles to hold, and print one line per vehicle. Return the exit code."""
    now = time.monotonic()
    holds = [(Hold(t.name, t.id, now, simulated=t.run is not None, signs=t.signs), _open(t)) for t in targets]
    printed: set[str] = set()
    while len(printed) < len(holds):
        now = time.monotonic()
        for one, sock in holds:
            for frame in one.due(now):
                _send(sock, frame)
            if one.result and one.name not in printed:
                printed.add(one.name)
                print(one.result, flush=True)
        readable, _, _ = select.select([sock for _, sock in holds], [], [], 0.02)
        for one, sock in holds:
            while sock in readable and (data := _receive(sock)):
                one.on_datagram(data, time.monotonic())
    return EXIT_OK if all(one.confirmed for one, _ in holds) else EXIT_FAILED


def _open(target: Target) -> socket.socket:
    sock = open_udp((target.tools[0], 0))
    sock.connect(target.tools)
    return sock


def _send(sock: socket.socket, data: bytes) -> None:
    try:
        sock.send(data)
    except OSError:  # no router listens
        return


def _receive(sock: socket.socket) -> bytes:
    try:
        return sock.recv(1 << 16)
    except OSError:
        return b""


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m arena.monitor.hold", allow_abbrev=False)
    parser.add_argument("--run", type=Path, required=True, metavar="DIR", help="the run folder")
    parser.add_argument("vehicles", nargs="+", help="names of the vehicles")
    given = parser.parse_args(argv)
    try:
        return hold(choose(find(run=given.run).targets, given.vehicles))
    except ArenaError as error:
        print(f"hold: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
