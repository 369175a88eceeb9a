"""PX4's simulator API for one vehicle, without its socket: samples in, HIL messages out, motor commands back.

PX4 runs free until it has found its sensors and answers nothing; from its first HIL_ACTUATOR_CONTROLS on it answers each
HIL_SENSOR with exactly one, and its clock is the time stamps it is sent. A group of fields_updated is sent whole or not at all,
for a half one is refused.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.atmosphere import pressure_hpa
from arena.wire.truth import Truth

Array = NDArray[np.float64]

_IMU, _MAG, _BARO = 0x03F, 0x1C0, 0x1A00
_MAG_EVERY, _BARO_EVERY, _TRUTH_EVERY = 3, 5, 5
_ARMED, _LOCKSTEP = 128, 1
_CELSIUS = 25.0
_LATELY = 256


class SimulatorLink:
    """One vehicle. rotors: how many commands it takes from the front of `controls`.

    motors: its newest commands 0..1 (rotors,), all 0 while disarmed. owed: samples sent and not answered yet, once in step.
    """

    def __init__(self, rotors: int) -> None:
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=200)
        self._codec.robust_parsing = True
        self._rotors = rotors
        self.counts: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """A new PX4 has connected."""
        self.motors: Array = np.zeros(self._rotors)
        self.armed, self.in_step, self.owed = False, False, 0
        self._samples, self._sent_us, self._stamped = 0, 0, False
        self._sent_lately: deque[int] = deque(maxlen=_LATELY)
        self._codec.buf, self._codec.buf_index = bytearray(), 0

    def sample(self, now: float, sensors: Mapping[str, Array], row: int) -> bytes:
        """The messages of one sensor period that ends at now [s]. sensors: as the world's `sense`; row: this vehicle's."""
        fields = _IMU
        fields |= _MAG if self._samples % _MAG_EVERY == 0 else 0
        fields |= _BARO if self._samples % _BARO_EVERY == 0 else 0
        height = float(sensors["baro_alt_m"][row])
        self._sent_us = round(now * 1e6)
        self._sent_lately.append(self._sent_us)
        m = mavlink.MAVLink_hil_sensor_message(
            self._sent_us, *(x for key in ("accel_b", "gyro_b", "mag_b") for x in sensors[key][row].tolist()),
            pressure_hpa(height), 0.0, height, _CELSIUS, fields, 0,
        )  # fmt: skip
        self._samples += 1
        if self.in_step:
            self.owed += 1
        return bytes(m.pack(self._codec))

    def truth(self, now: float, truth: Truth, row: int, origin: tuple[float, float, float] | None) -> bytes:
        """HIL_STATE_QUATERNION, at a fifth of the sensor rate: what PX4 logs as ground truth. b"" in between."""
        if self._samples % _TRUTH_EVERY:
            return b""
        lat, lon, alt = _global(truth.p_n[row], origin or (0.0, 0.0, 0.0))
        v, a = truth.v_n[row], truth.accel_b[row]
        speed = float(np.sqrt(v @ v))
        m = mavlink.MAVLink_hil_state_quaternion_message(
            round(now * 1e6), truth.q_nb[row].tolist(), *truth.omega_b[row].tolist(), lat, lon, round(alt * 1e3),
            *(_int16(100.0 * x) for x in v), _int16(100 * speed) & 0x7FFF, _int16(100 * speed) & 0x7FFF,
            *(_int16(x / 9.80665e-3) for x in a),
        )  # fmt: skip
        return bytes(m.pack(self._codec))

    def hear(self, data: bytes) -> None:
        """A piece of PX4's byte stream."""
        for m in self._codec.parse_buffer(data) or []:
            kind = m.get_type()
            if kind == "HIL_ACTUATOR_CONTROLS":
                self._obey(m)
            elif kind == "BAD_DATA":
                self.counts["garbage"] += 1

    def _obey(self, m: Any) -> None:
        self.in_step = self.in_step or bool(m.flags & _LOCKSTEP)
        # PX4 stamps an answer with the time of the sample it answers, which tells those to the free run's samples apart.
        self._stamped = self._stamped or m.time_usec in self._sent_lately
        if m.time_usec >= self._sent_us or not self._stamped:
            self.owed = max(self.owed - 1, 0)
        self.armed = bool(m.mode & _ARMED)
        commands = [c if math.isfinite(c) else 0.0 for c in m.controls[: self._rotors]]
        self.motors = np.clip(commands, 0.0, 1.0) if self.armed else np.zeros(self._rotors)
        self.counts["answers"] += 1


def _global(p_n: Array, origin: tuple[float, float, float]) -> tuple[int, int, float]:
    lat0, lon0, alt0 = origin
    lat = lat0 + math.degrees(p_n[0] / 6_371_000.0)
    lon = lon0 + math.degrees(p_n[1] / (6_371_000.0 * math.cos(math.radians(lat0))))
    return round(lat * 1e7), round(lon * 1e7), float(alt0 - p_n[2])


def _int16(x: float) -> int:
    return round(min(max(x, -32768.0), 32767.0))
