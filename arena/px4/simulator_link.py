"""PX4's simulator API for one vehicle, without its socket: samples in, HIL messages out, motor commands back.

PX4 runs free until it has found its sensors and answers nothing; from its first HIL_ACTUATOR_CONTROLS on it answers each
HIL_SENSOR with exactly one, and its clock is the time stamps it is sent. A group of fields_updated is sent whole or not at all,
for a half one is refused.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from arena.atmosphere import pressure_hpa
from arena.constants import GRAVITY_M_S2
from arena.geometry import globe_from_local
from arena.wire import hil
from arena.wire.mavlink_frame import Stream
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

_IMU, _MAG, _BARO = 0x03F, 0x1C0, 0x1A00
_MAG_EVERY, _BARO_EVERY, _TRUTH_EVERY = 3, 5, 5
_CELSIUS = 25.0
_GPS_ACCURACY_CM, _SATELLITES = (80, 120), 14
# Sticks in the middle, throttle too: they hold nothing up and take nothing over.
_STICKS_EVERY, _STICKS_US = 5, (1500,) * 8
_LATELY = 256


class SimulatorLink:
    """One vehicle. rotors: how many commands it takes from the front of `controls`. sticks: a pilot's radio is on; may change.

    motors: its newest commands, 0..1 [-], one a rotor, all 0 while disarmed. owed: samples not answered yet, once in step.
    """

    def __init__(self, rotors: int, *, sticks: bool = False) -> None:
        self._sender = hil.HilSender(1, 200)
        self._rotors, self.sticks = rotors, sticks
        self.counts: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """A new PX4 has connected."""
        self.motors = [0.0] * self._rotors
        self.armed, self.in_step, self.owed = False, False, 0
        self._samples, self._sent_us, self._stamped = 0, 0, False
        self._sent_lately: deque[int] = deque(maxlen=_LATELY)
        self._stream = Stream()

    def sample(self, now: float, sensors: Mapping[str, Array], row: int) -> bytes:
        """The messages of one sensor period that ends at now [s]. sensors: as the world's `sense`; row: this vehicle's."""
        fields = _IMU
        fields |= _MAG if self._samples % _MAG_EVERY == 0 else 0
        fields |= _BARO if self._samples % _BARO_EVERY == 0 else 0
        height = float(sensors["baro_alt_m"][row])
        self._sent_us = round(now * 1e6)
        self._sent_lately.append(self._sent_us)
        self._samples += 1
        if self.in_step:
            self.owed += 1
        inertial = (x for key in ("accel_b", "gyro_b", "mag_b") for x in sensors[key][row].tolist())
        data = self._sender.sensor(
            self._sent_us, (*inertial, pressure_hpa(height), 0.0, height, _CELSIUS), fields
        )
        if self.sticks and self._samples % _STICKS_EVERY == 0:
            data += self._sender.sticks(round(now * 1e3), _STICKS_US)
        return data

    def gps(self, now: float, sensors: Mapping[str, Array], row: int) -> bytes:
        """HIL_GPS. sensors: as the world's `gps`; row: this vehicle's."""
        lat, lon, alt = (float(sensors[key][row]) for key in ("lat_deg", "lon_deg", "alt_m"))
        v_cm_s = [_int16(100.0 * x) for x in sensors["v_true_n"][row].tolist()]
        place = (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3))
        return self._sender.gps(round(now * 1e6), place, _GPS_ACCURACY_CM, v_cm_s, _SATELLITES)

    def truth(self, now: float, truth: Truth, row: int, origin: tuple[float, float, float] | None) -> bytes:
        """HIL_STATE_QUATERNION, at a fifth of the sensor rate: what PX4 logs as ground truth. b"" in between."""
        if self._samples % _TRUTH_EVERY:
            return b""
        lat, lon, alt = _global(truth.p_n[row], origin or (0.0, 0.0, 0.0))
        v, a = truth.v_n[row].tolist(), truth.accel_b[row].tolist()
        return self._sender.state(
            round(now * 1e6),
            truth.q_nb[row].tolist(),
            truth.omega_b[row].tolist(),
            (lat, lon, round(alt * 1e3)),
            [_int16(100.0 * x) for x in v],
            _int16(100.0 * math.hypot(*v)),
            [_int16(1e3 * x / GRAVITY_M_S2) for x in a],
        )

    def hear(self, data: bytes) -> None:
        """A piece of PX4's byte stream."""
        buffer, found = self._stream.feed(data)
        if found.garbage:
            self.counts["garbage"] += found.garbage
        for frame in found.frames:
            if frame.msgid == hil.HIL_ACTUATOR_CONTROLS:
                self._obey(hil.controls(buffer, frame))

    def _obey(self, m: hil.Controls) -> None:
        self.in_step = self.in_step or m.lockstep
        # PX4 stamps an answer with the time of the sample it answers, which tells those to the free run's samples apart.
        self._stamped = self._stamped or m.time_usec in self._sent_lately
        if not self._stamped:
            self.owed = max(self.owed - 1, 0)
        elif m.time_usec >= self._sent_us:
            self.owed = 0
        else:  # of an older one: those after it are owed
            self.owed = min(self.owed, sum(sent > m.time_usec for sent in self._sent_lately))
        self.armed = m.armed
        outputs = m.controls[: self._rotors] if m.armed else (0.0,) * self._rotors
        self.motors = [min(max(x, 0.0), 1.0) if math.isfinite(x) else 0.0 for x in outputs]
        self.counts["answers"] += 1


def _global(p_n: Array, origin: tuple[float, float, float]) -> tuple[int, int, float]:
    lat0, lon0, alt0 = origin
    lat, lon = globe_from_local(lat0, lon0, p_n[0], p_n[1])
    return round(lat * 1e7), round(lon * 1e7), float(alt0 - p_n[2])


def _int16(x: float) -> int:
    return round(min(max(x, -32768.0), 32767.0))
