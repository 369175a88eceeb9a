"""The simulator's side of PX4's simulator API for one vehicle, without a socket.

It encodes sensor samples as HIL messages, and decodes motor commands from the replies.

PX4 runs free and sends no replies until it has found its sensors. From its first HIL_ACTUATOR_CONTROLS on it
replies to each HIL_SENSOR with exactly one message, and its clock follows the time stamps of the messages.
The bits of one sensor in fields_updated are set together or not at all, because PX4 refuses a sample with
only some of them.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.geometry import EARTH_M
from arena.kernels.arrays import view
from arena.kernels.global_coordinates import latitude_longitude
from arena.kernels.motor_replies import MotorReplies
from arena.wire import hil
from arena.wire.mavlink_frame import PARSER, Stream
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

_TRUTH_EVERY = 5  # samples
# Centred sticks and throttle: they do not move the vehicle, and PX4 does not interpret them as input of a pilot.
_STICKS_EVERY, _STICKS_US = 5, (1500,) * 8
_SENT_TIMES = 256


class SimulatorLink:
    """Codec for PX4's simulator API of one vehicle: encodes sensor samples, decodes motor commands.

    rotors: number of motor commands; they are the first ones of `controls`
    outputs: data that each simulated sensor adds
    sticks: whether the pilot's radio control is on; may be changed
    motors: latest motor commands 0..1 [-], all 0 while disarmed (rotors,)
    has_replied: whether PX4 has sent motor commands since it connected
    unanswered: number of samples sent without a reply so far, counted once PX4 is in lockstep
    """

    def __init__(self, rotors: int, outputs: Sequence[hil.HilOutput], *, sticks: bool = False) -> None:
        self._sender = hil.HilSender(1, 200)
        self.sticks = sticks
        self._readings = np.zeros(hil.READINGS, np.float32)
        self._fields = [
            (x, self._readings[x.first : x.first + x.count]) for x in outputs if isinstance(x, hil.HilFields)
        ]
        self._messages = [x for x in outputs if isinstance(x, hil.HilMessage)]
        self.counts: Counter[str] = Counter()
        self.motors: Array = np.zeros(rotors)
        self.reset()

    @property
    def armed(self) -> bool:
        """True if PX4 was armed when it sent the newest reply."""
        return self._replies.armed

    def reset(self) -> None:
        """Reset the state of the link, such as motor commands and armed flag, before PX4 connects again."""
        self.motors[:] = 0.0
        self._replies = MotorReplies(PARSER, hil.HIL_ACTUATOR_CONTROLS, view(self.motors))
        self.in_step, self.has_replied, self.unanswered = False, False, 0
        self._samples, self._first_us, self._sent_us, self._stamped = 0, 0, 0, False
        self._readings[:] = 0.0
        self._sent_times: deque[int] = deque(maxlen=_SENT_TIMES)
        self._stream = Stream()

    def sample(self, now: float, sensors: Mapping[str, Array], row: int) -> bytes:
        """Return the latest sensor readings as HIL_SENSOR, with RC_CHANNELS if radio control is on.

        PX4 uses only the readings that are marked as new. The others are repeated. The sticks of the radio control are centred.

        now: simulation time at the end of the period [s]
        sensors: readings of the world's sensors
        row: row of this vehicle in the readings
        """
        bits = 0
        for sensor, values in self._fields:
            if self._samples % sensor.every == 0:
                sensor.write(values, sensors, row)
                bits |= sensor.bits
        self._sent_us = round(now * 1e6)
        self._first_us = self._first_us if self._samples else self._sent_us
        self._sent_times.append(self._sent_us)
        self._samples += 1
        if self.in_step:
            self.unanswered += 1
        data = self._sender.sensor(self._sent_us, self._readings, bits)
        if self.sticks and self._samples % _STICKS_EVERY == 0:
            data += self._sender.sticks(round(now * 1e3), _STICKS_US)
        return data

    def messages(self, now: float, sensors: Mapping[str, Array], row: int, carried: frozenset[str]) -> bytes:
        """Return the messages of sensors that need a separate message, such as HIL_GPS.

        Only sensors that were sampled now and that the vehicle carries are included.

        now: simulation time [s]
        sensors: readings of the world's sensors
        row: row of this vehicle in the readings
        carried: names of the messages of the sensors that the vehicle carries
        """
        return b"".join(
            m.pack(self._sender, round(now * 1e6), sensors, row)
            for m in self._messages
            if m.name in carried and m.reading in sensors
        )

    def truth(self, now: float, truth: Truth, row: int, origin: tuple[float, float, float] | None) -> bytes:
        """Return the true state as HIL_STATE_QUATERNION at every fifth sample, else b"".

        PX4 logs it as ground truth.
        """
        if self._samples % _TRUTH_EVERY:
            return b""
        lat, lon, alt = _global(truth.p_n[row].tolist(), origin or (0.0, 0.0, 0.0))
        v, a = truth.v_n[row].tolist(), truth.accel_b[row].tolist()
        return self._sender.state(
            round(now * 1e6),
            truth.q_nb[row].tolist(),
            truth.omega_b[row].tolist(),
            (lat, lon, round(alt * 1e3)),
            [_int16(100.0 * x) for x in v],
            _int16(100.0 * math.hypot(*v)),
            [_int16(x / (1e-3 * GRAVITY_M_S2)) for x in a],
        )

    def receive(self, data: bytes) -> None:
        """Update motor commands and armed flag from bytes that PX4 has sent.

        The bytes may end in the middle of a message.
        """
        if self._stream.is_clean and self._replies.read(data):
            return self._take_reply()
        buffer, found = self._stream.feed(data)
        if found.garbage:
            self.counts["garbage"] += found.garbage
        for frame in found.frames:
            if frame.msgid == hil.HIL_ACTUATOR_CONTROLS:
                self._replies.read_payload(buffer, frame.payload, frame.size)
                self._take_reply()

    def _take_reply(self) -> None:
        newest, self.has_replied = self._replies, True
        self.in_step = self.in_step or newest.lockstep
        # PX4 stamps a reply with the time of the sample it replies to. This separates replies to lockstep samples from
        # those to samples of the free run, of which more can be without a reply than `_sent_times` has room for.
        self._stamped = self._stamped or self._first_us <= newest.time_usec <= self._sent_us
        if not self._stamped:
            self.unanswered = max(self.unanswered - 1, 0)
        elif newest.time_usec >= self._sent_us:
            self.unanswered = 0
        else:  # reply to an older sample: the samples after it still have no reply
            self.unanswered = min(self.unanswered, sum(sent > newest.time_usec for sent in self._sent_times))
        self.counts["answers"] += 1


def _global(p_n: Sequence[float], origin: tuple[float, float, float]) -> tuple[int, int, float]:
    lat0, lon0, alt0 = origin
    lat, lon = latitude_longitude(p_n[0], p_n[1], 0.0, lat0, lon0, EARTH_M)
    return round(lat * 1e7), round(lon * 1e7), alt0 - p_n[2]


def _int16(x: float) -> int:
    return round(min(max(x, -32768.0), 32767.0))
