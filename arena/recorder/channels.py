"""Output channels of the recorder: their interface, and the raw channels for data as received.

The raw channels are the record from which the logs of a flight are computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from arena.kernels.mcap_messages import log_datagrams
from arena.kernels.viewer_meters import nanoseconds
from arena.mocap.client import CapturedFrame
from arena.recorder.mcap_file import MakeChannel
from arena.wire.flight_record import (
    CAPTURED_FRAME,
    CDR_ENCODING,
    DATAGRAM,
    EVENT,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    JSON_ENCODING,
    MAVLINK_ENCODING,
    TRUE_STATE,
    down_topic,
    pack_frame,
    pack_true_state,
    truth_topic,
    up_topic,
)
from arena.wire.truth_rows import TrueStates, as_lists

Datagram = tuple[str, bool, bytes, float]
"""(vehicle, up, data, time_s) of a MAVLink datagram: the name of its vehicle, True if it was sent to the vehicle, its bytes, and its
time of reception by the run's clock [s]."""


class RecordChannels(Protocol):
    """Interface of one set of the recorder's output channels, such as the channels for Foxglove.

    The recorder calls the methods for all data that it receives, in the order of reception.

    The methods run in the recorder's loop, in the fused arena in the step of the world: they must not block.
    time_s: time of reception by the run's clock [s]; the log time of the message. For a datagram it is the last element of `Datagram`.
    """

    def on_datagrams(self, datagrams: list[Datagram]) -> None:
        """Log MAVLink datagrams that vehicles have sent or received, oldest first.

        Each contains one or more complete MAVLink frames. References that the vehicle's program publishes are `up`, too.
        """

    def on_frame(self, frame: CapturedFrame, simulated: bool, time_s: float) -> None:
        """Log one motion capture frame: the poses of all bodies at one instant.

        simulated: the motion-capture emulator sent it.
        """

    def on_truth(self, truth: TrueStates, time_s: float) -> None:
        """Log the true state of all simulated vehicles. The recorder calls this `log.rate_hz` times per simulated second.

        truth: row i is the vehicle with `index` i in the recorder's configuration (slice).
        """

    def on_event(self, line: bytes, fields: Mapping[str, Any], time_s: float) -> None:
        """Log one line of the event file events.jsonl.

        line: the JSON object as bytes, without the line end.
        fields: its content.
        """


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A vehicle of the recording.

    index: its row in the truth page, None for a real vehicle.
    """

    name: str
    id: int
    body: str | None
    index: int | None


class RawChannels:
    """Channels that store all received data unchanged. `arena.flight_log.recording` reads them.

    vehicles: vehicles of the arena.  channel: creates a channel in the record.
    """

    def __init__(self, vehicles: Sequence[Recorded], channel: MakeChannel) -> None:
        names = [v.name for v in vehicles]
        self._down = {name: channel(down_topic(name), MAVLINK_ENCODING, DATAGRAM) for name in names}
        self._up = {name: channel(up_topic(name), MAVLINK_ENCODING, DATAGRAM) for name in names}
        self._truth = [
            (v.index, channel(truth_topic(v.name), CDR_ENCODING, TRUE_STATE))
            for v in vehicles
            if v.index is not None
        ]
        self._log_frame = channel(FRAMES_TOPIC, CDR_ENCODING, CAPTURED_FRAME)
        self._log_event = channel(EVENTS_TOPIC, JSON_ENCODING, EVENT)

    def on_datagrams(self, datagrams: list[Datagram]) -> None:
        log_datagrams(datagrams, self._down, self._up)

    def on_frame(self, frame: CapturedFrame, simulated: bool, time_s: float) -> None:
        sent_s = float("nan") if frame.sent_s is None else frame.sent_s
        data = pack_frame(frame.number, frame.time_s, sent_s, simulated, frame.poses, frame.untracked)
        self._log_frame(data, nanoseconds(time_s))

    def on_truth(self, truth: TrueStates, time_s: float) -> None:
        log_time = nanoseconds(time_s)
        p_n, v_n = as_lists(truth.p_n), as_lists(truth.v_n)
        q_nb, omega_b = as_lists(truth.q_nb), as_lists(truth.omega_b)
        for index, log in self._truth:
            log(pack_true_state(p_n[index], v_n[index], q_nb[index], omega_b[index]), log_time)

    def on_event(self, line: bytes, fields: Mapping[str, Any], time_s: float) -> None:
        self._log_event(line, nanoseconds(time_s))
