"""Last reported states of N vehicles, from their telemetry and the heartbeats of their programs.

Pure.

Only the needed bytes of each MAVLink frame are read, because fifty vehicles send thousands of frames per
second.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame, byte_at, parse_frames, uint_at
from arena.wire.mavlink_ids import COPILOT
from arena.wire.px4_mode import mode_words

Array = NDArray[np.float64]

HEARTBEAT, SYS_STATUS, LOCAL, TARGET, ACK, EXTENDED = 0, 1, 32, 85, 77, 245
_ARMED = 128
_NONE, _IN_PROGRESS = 0, 5
_UNDEFINED, _ON_GROUND = 0, 1  # MAV_LANDED_STATE
_STILL_M = 0.03
_XYZ = struct.Struct("<fff")
_NO_POSITION = 0b111


class VehicleStates:
    """Last reported state of each vehicle.

    ids: MAV_SYS_ID of each row. Times are by the caller's clock [s], -inf before the first message.
    """

    def __init__(self, ids: Sequence[int]) -> None:
        n = len(ids)
        self._rows = {system: i for i, system in enumerate(ids)}
        self.mode = [""] * n
        self.armed: list[bool | None] = [None] * n
        self.landed: list[bool | None] = [None] * n
        self.heartbeat_at = np.full(n, -np.inf)
        self.estimate, self.estimate_at = np.full((n, 3), np.nan), np.full(n, -np.inf)
        self.target, self.target_at = np.full((n, 3), np.nan), np.full(n, -np.inf)
        self.target_since = np.full(n, np.inf)
        """Time since which the target stands still [s]."""
        self.battery, self.battery_at = np.full(n, np.nan), np.full(n, -np.inf)
        self.program_heartbeat_at = np.full(n, -np.inf)
        """Time of the program's last heartbeat in this arming [s]."""
        self.refusals: list[tuple[int, int, int]] = []
        """(row, command, result) of refused commands; the code that reads the list must also empty it."""
        self.counts: Counter[str] = Counter()

    def on_datagram(self, row: int | None, data: Buffer, now: float) -> None:
        """Read a datagram, and update the states of vehicles and programs from its messages.

        row: vehicle from whose tools port the datagram came. None for any other sender, from which only
        program heartbeats are used.
        """
        found = parse_frames(data)
        if found.garbage or found.bad_crc:
            self.counts["garbled"] += 1
        for frame in found.frames:
            vehicle = self._rows.get(frame.sysid)
            if vehicle is None:
                continue
            if frame.compid == AUTOPILOT and vehicle == row:
                self._autopilot(vehicle, data, frame, now)
            elif row is None and frame.msgid == HEARTBEAT and frame.compid != AUTOPILOT:
                self.counts["program heartbeats"] += 1
                self.program_heartbeat_at[vehicle] = now

    def _autopilot(self, i: int, data: Buffer, frame: Frame, now: float) -> None:
        match frame.msgid:
            case 0:
                self._heartbeat(i, data, frame, now)
            case 1:
                left = byte_at(data, frame, 30)
                self.battery[i], self.battery_at[i] = (left / 100.0 if left <= 100 else np.nan), now
            case 32:
                self.estimate[i], self.estimate_at[i] = _xyz(data, frame, 4), now
            case 85:
                self._target(i, data, frame, now)
            case 245:
                state = byte_at(data, frame, 1)
                if state != _UNDEFINED:  # an undefined state does not replace the last one
                    self.landed[i] = state == _ON_GROUND
            case 77 if (frame.target_sys, frame.target_comp) == (COPILOT.system, COPILOT.component):
                result = byte_at(data, frame, 2)
                if result not in (_NONE, _IN_PROGRESS):
                    self.refusals.append((i, uint_at(data, frame, 0, 2), result))

    def _heartbeat(self, i: int, data: Buffer, frame: Frame, now: float) -> None:
        armed = bool(byte_at(data, frame, 6) & _ARMED)
        if not armed:
            self.program_heartbeat_at[i] = -np.inf  # the next arming starts without one
        self.mode[i], self.armed[i], self.heartbeat_at[i] = mode_words(uint_at(data, frame, 0, 4)), armed, now

    def _target(self, i: int, data: Buffer, frame: Frame, now: float) -> None:
        ignored = uint_at(data, frame, 48, 2) & _NO_POSITION
        place = np.full(3, np.nan) if ignored else _xyz(data, frame, 4)
        moved = np.abs(place - self.target[i])
        if not (moved <= _STILL_M).all():  # true also when either is NaN
            self.target_since[i] = now if np.isfinite(place).all() else np.inf
            self.target[i] = place
        self.target_at[i] = now


def _xyz(data: Buffer, frame: Frame, offset: int) -> Array:
    """Return three consecutive floats, such as a position, of a MAVLink payload.

    offset: of the first float [bytes]

    Missing bytes count as zero, because MAVLink 2 truncates trailing zeros.
    """
    start = frame.payload + offset
    raw = bytes(data[start : min(start + 12, frame.payload + frame.size)])
    return np.array(_XYZ.unpack(raw.ljust(12, b"\0")), dtype=np.float64)
