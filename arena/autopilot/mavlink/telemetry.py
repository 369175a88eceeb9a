"""Telemetry of all built-in autopilots: the streams of their links, and the state that the messages contain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.mavlink import streams
from arena.autopilot.mavlink.link import LinkStreams, MavlinkLink
from arena.autopilot.mavlink.packed_messages import FREQUENT, PACKED
from arena.autopilot.mavlink.status_messages import HAS_CONTENT as RARE_HAS_CONTENT
from arena.autopilot.mavlink.telemetry_packer import HAS_CONTENT, NEEDS_POSITION, TelemetryPacker
from arena.autopilot.mavlink.telemetry_state import TelemetryState
from arena.autopilot.vehicle import Vehicle
from arena.kernels.arrays import array, integers
from arena.kernels.stream_schedule import StreamSchedule
from arena.kernels.stream_sender import StreamSender

Array = NDArray[np.float64]

_PHASE_S, _PHASES = 0.004, 5  # phase shift between the streams of neighbouring vehicles
_IDS = sorted(streams.SUPPORTED)
_COLUMNS = {msgid: column for column, msgid in enumerate(_IDS)}
_HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_LINKS = list(streams.LINK_RATES)
_HAS_CONTENT = {_COLUMNS[msgid]: test for msgid, test in {**HAS_CONTENT, **RARE_HAS_CONTENT}.items()}


class Telemetry:
    """Telemetry of V vehicles: sends the message streams that are due on their links.

    packer: packs the messages of the table `PACKED`
    read_state: function that returns the state of all vehicles at the last step; None before the first step
    wake_s: time from which the MAVLink interface of a vehicle must send, because it has more to send than streams [s] (V,)
    """

    def __init__(
        self,
        vehicles: Sequence[Vehicle],
        packer: TelemetryPacker,
        read_state: Callable[[], TelemetryState | None],
    ) -> None:
        self.packer, self._read_state = packer, read_state
        self._sequence = np.zeros(len(vehicles) * len(_LINKS), np.int64)
        self._schedule = StreamSchedule(len(self._sequence), integers(np.array(_IDS, np.int64)))
        self._silent = np.zeros((len(vehicles), len(_IDS)), bool)
        self._sender = StreamSender(
            self._schedule,
            packer.law,
            _LINKS,
            integers(np.array([v.system_id for v in vehicles], np.int64)),
            integers(self._sequence),
            [packer.law.writers.get(msgid) for msgid in _IDS],
            np.array([msgid not in FREQUENT for msgid in _IDS]),
            np.array([msgid in NEEDS_POSITION for msgid in _IDS]),
            self._silent,
        )
        self.wake_s = array(self._sender.wake_s)
        self._copied: list[object] = [None] * len(vehicles)

    def links(self, v: Vehicle) -> dict[str, MavlinkLink]:
        """Return the MAVLink links of a vehicle, with the default rates of their streams.

        The link for ground stations sends only HEARTBEAT until a message arrives.
        """
        # All streams of one vehicle are in phase, so that they share datagrams; those of different vehicles are not.
        first_s = _PHASE_S * (v.row % _PHASES)
        links = {}
        for k, name in enumerate(_LINKS):
            row = v.row * len(_LINKS) + k
            link = MavlinkLink(
                name, v.system_id, LinkStreams(self._schedule, row, _COLUMNS), self._sequence, row
            )
            link.waiting = name == streams.GROUND
            if link.waiting:
                link.streams.set_interval(_HEARTBEAT, 1.0 / streams.LINK_RATES[name][_HEARTBEAT], first_s)
            else:
                self.start_streams(link, first_s)
            links[name] = link
        return links

    def start_streams(self, link: MavlinkLink, first_s: float) -> None:
        """Start each default message stream of a link, except the streams that run already.

        first_s: time of the first messages [s]
        """
        for msgid, hz in streams.LINK_RATES[link.name].items():
            if not link.streams.interval(msgid):
                link.streams.set_interval(msgid, 1.0 / hz, first_s)

    def begin(self) -> TelemetryState | None:
        """Prepare messages that a client requested. Return the state of all vehicles after the previous step.

        Return None before the first step.
        """
        state = self._read_state()
        if state is not None:
            self.packer.begin(state.now_s, state.sensors)
        return state

    def update(self, v: Vehicle) -> None:
        """Copy rarely changing values of a vehicle, such as mode and origin, to the telemetry packer.

        Values that have not changed are not copied.
        """
        c, p = v.commander, v.commander_params
        values = (
            (c.mode, c.armed, c.failsafe, v.landed_state, v.ready_to_arm, v.inputs.manual_control),
            (c.intended, p.bat_low_thr, p.bat_crit_thr, p.bat_emergen_thr),
            (v.aligned, v.origin, v.home_n, v.orbit, v.leg_target_n, v.manual_control.radio > -math.inf),
            v.is_logged,
        )
        if values != self._copied[v.row]:
            self._copied[v.row] = values
            self.packer.set_status(v)
            self.packer.set_place(v)
            for column, has_content in _HAS_CONTENT.items():
                self._silent[v.row, column] = not has_content(v)

    def send(self, v: Vehicle, link: MavlinkLink, message_ids: Sequence[int], state: TelemetryState) -> bool:
        """Queue telemetry messages of a vehicle on a link. Return whether any message was queued.

        The rare messages are the first, as in the kernel `stream_sender`. A message is not queued if it is not supported or
        has no valid content.

        state: state of all vehicles
        """
        frequent, sent = [], False
        for msgid in message_ids:
            if msgid in FREQUENT:
                frequent.append(msgid)
            elif msgid in PACKED:
                sent = self._send_packed(v, link, [msgid]) or sent
            elif (build := streams.BUILDERS.get(msgid)) and (message := build(v, state)) is not None:
                link.send(message)
                sent = True
        return self._send_packed(v, link, frequent) or sent

    def _send_packed(self, v: Vehicle, link: MavlinkLink, message_ids: Sequence[int]) -> bool:
        """Queue messages that the kernel packs, as one entry of the link's queue. Return whether any message was queued."""
        packed = [msgid for msgid in message_ids if self._sender.has_content(v.row, _COLUMNS[msgid])]
        if packed:
            count = self.packer.frame_count(v, packed)
            link.send_frames(count, lambda seq: self.packer.pack(v, packed, link.row, seq))
        return bool(packed)

    def has_output(self, now: float) -> bool:
        """Return whether any vehicle has a MAVLink message to send at `now` [s]."""
        return self._sender.has_output(now)

    def send_streams(self, now: float, sensors: Mapping[str, Array]) -> list[tuple[int, str, bytes]]:
        """Return (row of the vehicle, link, datagram) for the streams that are due at `now` [s].

        sensors: as for `Autopilots.step`

        (row, "", b"") means that the MAVLink interface of this vehicle must send, because it has more to send than
        packed messages.
        """
        self.packer.begin(now, sensors)
        return self._sender.step(now)
