"""Reads the message times and pose delays of all vehicles (`LinkRecord`) from the record of a flight."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from arena.flight_log.recording import Recording
from arena.geometry import Array
from arena.report.link_record import LinkRecord, StatusText
from arena.wire.flight_record import FRAMES_TOPIC, down_topic, unpack_frame, up_topic
from arena.wire.mavlink_frame import AUTOPILOT, parse_frames, uint_at
from arena.wire.mavlink_minimal import STATUSTEXT, parse_statustext

_STATUSTEXT_ID = STATUSTEXT.to_bytes(3, "little")
_NUMBER, _PART = (
    (51, 2),
    (53, 1),
)  # offset and bytes in STATUSTEXT: a long text is sent in parts with one number
_ID_OFFSET = 7  # of the message id in a MAVLink 2 frame


def _floats() -> array[float]:
    return array("d")


@dataclass(kw_only=True)
class _Collected:
    """Message times, pose times and texts of one vehicle, while the record of a flight is read.

    Times are on the run's clock [s].
    """

    system: int
    body: str
    simulated: bool
    down_s: array[float] = field(default_factory=_floats)
    up_s: array[float] = field(default_factory=_floats)
    pose_s: array[float] = field(default_factory=_floats)
    age_s: array[float] = field(default_factory=_floats)
    texts: list[StatusText] = field(default_factory=list)
    _text_number: int = 0

    def add_down(self, time_s: float, data: bytes) -> None:
        self.down_s.append(time_s)
        if data.find(_STATUSTEXT_ID, _ID_OFFSET) < 0:
            return
        for frame in parse_frames(data).frames:
            if frame.msgid == STATUSTEXT and (frame.sysid, frame.compid) == (self.system, AUTOPILOT):
                severity, text = parse_statustext(data, frame)
                number, part = uint_at(data, frame, *_NUMBER), uint_at(data, frame, *_PART)
                if number and part and number == self._text_number and self.texts:
                    before = self.texts[-1]
                    self.texts[-1] = StatusText(
                        at_s=before.at_s, severity=before.severity, text=before.text + text
                    )
                else:
                    self.texts.append(StatusText(at_s=time_s, severity=severity, text=text))
                self._text_number = number

    def add_up(self, time_s: float, _data: bytes) -> None:
        self.up_s.append(time_s)


def read_links(recording: Recording, origin_s: float) -> dict[str, LinkRecord]:
    """Return vehicle -> `LinkRecord`: its messages and poses over time. The file is read once.

    origin_s: time of the run's clock that is 0 on the report's time axis [s].
    """
    found = {v.name: _Collected(system=v.id, body=v.body, simulated=v.simulated) for v in recording.vehicles}
    by_topic: dict[str, Callable[[float, bytes], None]] = {}
    for name, one in found.items():
        by_topic |= {down_topic(name): one.add_down, up_topic(name): one.add_up}
    for topic, time_s, data in recording.messages({FRAMES_TOPIC, *by_topic}):
        receive = by_topic.get(topic)
        if receive is not None:
            receive(time_s, data)
            continue
        frame = unpack_frame(time_s, data)
        tracked = {body.name for body in frame.bodies if body.tracked}
        for one in found.values():
            if one.body in tracked and one.simulated == frame.simulated:
                one.pose_s.append(time_s)
                one.age_s.append(time_s - frame.exposed_s)
    return {name: _record(one, origin_s) for name, one in found.items()}


def _record(one: _Collected, origin_s: float) -> LinkRecord:
    ages = np.array(one.age_s, np.float64)
    if not one.simulated and ages.size:
        ages = ages - np.nanmin(ages)  # the server's clock differs from the clock of this computer
    return LinkRecord(
        down_s=_stamps(one.down_s, origin_s),
        up_s=_stamps(one.up_s, origin_s),
        pose_s=_stamps(one.pose_s, origin_s),
        pose_age_s=ages,
        texts=tuple(StatusText(at_s=t.at_s - origin_s, severity=t.severity, text=t.text) for t in one.texts),
    )


def _stamps(stamps: array[float], origin_s: float) -> Array:
    shifted: Array = np.array(stamps, np.float64) - origin_s
    return shifted
