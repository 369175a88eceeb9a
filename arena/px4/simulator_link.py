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
from arena.kernels.global_coordinates import latitude_longitude
from arena.wire import hil
from arena.wire.mavlink_frame import Stream
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

_READINGS = 13  # of HIL_SENSOR
_TRUTH_EVERY = 5  # samples
# Centred sticks and throttle: they do not move the vehicle, and PX4 does not interpret them as input of a pilot.
_STICKS_EVERY, _STICKS_US = 5, (1500,) * 8
_SENT_TIMES = 256


class SimulatorLink:
    """Codec for PX4's simulator API of one vehicle: encodes sensor samples, decodes motor commands.

    rotors: number of motor commands; they are the first ones of `controls`
    outputs: data that each simulated sensor adds
    sticks: whether the pilot's radio control is on; may be changed
    motors: latest motor commands 0..1 [-], one per rotor, all 0 while disarmed
    unanswered: number of samples sent without a reply so far, counted once PX4 is in lockstep
    """

    def __init__(self, rotors: int, outputs: Sequence[hil.HilOutput], *, sticks: bool = False) -> None:
        self._sender = hil.HilSender(1, 200)
        self._rotors, self.sticks = rotors, sticks
        self._fields = [x for x in outputs if isinstance(x, hil.HilFields)]
        self._messages = [x for x in outputs if isinstance(x, hil.HilMessage)]
        self.counts: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Reset the state of the link, such as motor commands and armed flag, before PX4 connects again."""
        self.motors = [0.0] * self._rotors
        self.armed, self.in_step, self.unanswered = False, False, 0
        self._samples, self._sent_us, self._stamped = 0, 0, False
        self._values = [0.0] * _READINGS
        self._sent_times: deque[int] = deque(maxlen=_SENT_TIMES)
        self._stream = Stream()

    def sample(self, now: float, sensors: Mapping[str, Array], row: int) -> bytes:
        """Return the latest sensor readings as HIL_SENSOR, with RC_CHANNELS if radio control is on.

        PX4 uses only the readings that are marked as new. The others are repeated. The sticks of the radio control are centred.

        now: simulation time at the end of the period [s]
        sensors: readings of the world's sensors
        row: row of this vehicle in the readings
        """
        values, bits = self._values, 0
        for sensor in self._fields:
            if self._samples % sensor.every == 0:
                found = sensor.values(sensors, row)
                values[sensor.first : sensor.first + len(found)] = found
                bits |= sensor.bits
        self._sent_us = round(now * 1e6)
        self._sent_times.append(self._sent_us)
        self._samples += 1
        if self.in_step:
            self.unanswered += 1
        data = self._sender.sensor(self._sent_us, values, bits)
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
        buffer, found = self._stream.feed(data)
        if found.garbage:
            self.counts["garbage"] += found.garbage
        for frame in found.frames:
            if frame.msgid == hil.HIL_ACTUATOR_CONTROLS:
                self._take_controls(hil.controls(buffer, frame))

    def _take_controls(self, m: hil.Controls) -> None:
        self.in_step = self.in_step or m.lockstep
        # PX4 stamps a reply with the time of the sample it replies to. This separates replies to lockstep samples from
        # those to samples of the free run.
        self._stamped = self._stamped or m.time_usec in self._sent_times
        if not self._stamped:
            self.unanswered = max(self.unanswered - 1, 0)
        elif m.time_usec >= self._sent_us:
            self.unanswered = 0
        else:  # reply to an older sample: the samples after it still have no reply
            self.unanswered = min(self.unanswered, sum(sent > m.time_usec for sent in self._sent_times))
        self.armed = m.armed
        outputs = m.controls[: self._rotors] if m.armed else (0.0,) * self._rotors
        self.motors = [min(max(x, 0.0), 1.0) if math.isfinite(x) else 0.0 for x in outputs]
        self.counts["answers"] += 1


def _global(p_n: Sequence[float], origin: tuple[float, float, float]) -> tuple[int, int, float]:
    lat0, lon0, alt0 = origin
    lat, lon = latitude_longitude(p_n[0], p_n[1], 0.0, lat0, lon0, EARTH_M)
    return round(lat * 1e7), round(lon * 1e7), alt0 - p_n[2]


def _int16(x: float) -> int:
    return round(min(max(x, -32768.0), 32767.0))
