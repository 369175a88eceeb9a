"""PX4's simulator API: encoder of the MAVLink 2 messages of each simulation step.

No sockets, no clocks.

The world sends these messages in every step. They are packed with struct layouts, which takes a
few microseconds per message instead of tens with pymavlink.

    HIL_SENSOR (107)             <Q 13f I B             time_usec, accel, gyro, mag, pressure, its difference, height, degrees,
                                                        fields, id
    HIL_STATE_QUATERNION (115)   <Q 4f 3f 3i 3h 2H 3h   time_usec, q_nb, rates, lat, lon, alt, velocity, two airspeeds, accel
    HIL_GPS (113)                <Q 3i 3H 3h H 2B       time_usec, lat, lon, alt, eph, epv, speed, velocity, course,
                                                        fix, satellites
    RC_CHANNELS (65)             <I 18H 2B              time_boot_ms, channels, their number, rssi
    HIL_ACTUATOR_CONTROLS (93)   <Q Q 16f B             time_usec, flags, controls, mode

`arena.kernels.motor_replies` reads HIL_ACTUATOR_CONTROLS.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arena.wire.mavlink_frame import SEEDS, pack_frame

HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_STATE_QUATERNION, HIL_GPS, RC_CHANNELS = 93, 107, 115, 113, 65
READINGS = 13
"""Number of readings in HIL_SENSOR."""
_TIME, _UPDATED, _STATE = struct.Struct("<Q"), struct.Struct("<IB"), struct.Struct("<Q4f3f3i3h2H3h")
_GPS, _RC = struct.Struct("<Q3i3H3hH2B"), struct.Struct("<I18H2B")
_UNKNOWN_COURSE, _FIX_3D, _UNUSED_CHANNEL, _RSSI = 65535, 3, 65535, 100


class HilSender:
    """Encoder of the simulator API messages that one MAVLink component sends.

    The sequence number increases with each message.
    """

    def __init__(self, system: int, component: int) -> None:
        self.srcSystem, self.srcComponent, self.seq = system, component, 0

    def sensor(self, time_usec: int, readings: ArrayLike, fields: int) -> bytes:
        """Encode HIL_SENSOR, the sensor readings that PX4 receives in each simulation step.

        readings: accel [m/s2], gyro [rad/s] and mag [gauss], each [FRD] (3,), then absolute and differential
        pressure [hPa], height [m] and temperature [deg C] (13,)
        fields: bits of the readings that are new
        """
        packed = np.asarray(readings, np.float32).reshape(READINGS).tobytes()
        return self._frame(HIL_SENSOR, _TIME.pack(time_usec) + packed + _UPDATED.pack(fields, 0))

    def state(
        self,
        time_usec: int,
        q_nb: Sequence[float],
        omega_b: Sequence[float],
        place: tuple[int, int, int],
        v_n_cm_s: Sequence[int],
        airspeed_cm_s: int,
        accel_mg: Sequence[int],
    ) -> bytes:
        """Encode HIL_STATE_QUATERNION, the true state of the vehicle, which PX4 only logs.

        q_nb: wxyz [-] (4,)
        place: latitude, longitude [1e-7 deg], altitude [mm]
        airspeed_cm_s: used as indicated and as true airspeed
        """
        payload = _STATE.pack(
            time_usec, *q_nb, *omega_b, *place, *v_n_cm_s, airspeed_cm_s, airspeed_cm_s, *accel_mg
        )
        return self._frame(HIL_STATE_QUATERNION, payload)

    def gps(
        self,
        time_usec: int,
        place: tuple[int, int, int],
        accuracy_cm: tuple[int, int],
        v_cm_s: Sequence[int],
        satellites: int,
    ) -> bytes:
        """Encode HIL_GPS, a simulated GPS measurement with a 3-D fix.

        place: latitude, longitude [1e-7 deg], altitude [mm]
        accuracy_cm: horizontal and vertical
        v_cm_s: true velocity [NED] (3,)
        """
        speed = min(round(sum(v * v for v in v_cm_s) ** 0.5), 65534)
        rest = (*place, *accuracy_cm, speed, *v_cm_s, _UNKNOWN_COURSE, _FIX_3D, satellites)
        return self._frame(HIL_GPS, _GPS.pack(time_usec, *rest))

    def sticks(self, time_ms: int, channels: Sequence[int]) -> bytes:
        """Encode RC_CHANNELS, the stick positions of a simulated radio control.

        channels: pulse widths [us], up to 18.
        """
        pulses = (*channels, *(_UNUSED_CHANNEL,) * (18 - len(channels)))
        return self._frame(RC_CHANNELS, _RC.pack(time_ms, *pulses, len(channels), _RSSI))

    def _frame(self, number: int, payload: bytes) -> bytes:
        made = pack_frame(number, payload, self, SEEDS[number])
        self.seq = (self.seq + 1) & 0xFF
        return made


Sensors = Mapping[str, Any]
"""Readings of the simulated sensors: name -> array over vehicles."""


@dataclass(frozen=True, kw_only=True)
class HilFields:
    """Conversion of one simulated sensor's readings to the fields of HIL_SENSOR that they fill.

    bits: bits of fields_updated. PX4 rejects a group if only some of its bits are set.
    every: number of sensor periods between two updates
    first, count: place of the values among HIL_SENSOR's 13 readings
    write: function that writes the values, in the units of HIL_SENSOR. Its arguments: array of the values (count,), readings, row of
        the vehicle
    """

    bits: int
    every: int
    first: int
    count: int
    write: Callable[[NDArray[np.float32], Sensors, int], None]


@dataclass(frozen=True, kw_only=True)
class HilMessage:
    """Conversion of one simulated sensor's readings to a separate message, such as HIL_GPS.

    name: key in the vehicle's row of the world's configuration; its value says whether the vehicle has the
    sensor
    every: number of sensor periods between two messages
    reading: name of the reading that the message needs; without it no message is sent
    pack: function (sender, time [us], readings, row of the vehicle) -> the frame
    """

    name: str
    every: int
    reading: str
    pack: Callable[[HilSender, int, Sensors, int], bytes]


HilOutput = HilFields | HilMessage
