"""MAVLink messages of the emulated relative sensors (DEBUG_FLOAT_ARRAY). Pure.

Sender: the vehicle's system, component 158.

    name         array_id                      data
    "neighbour"  system id of the neighbour    0..2  position relative to the vehicle: north, east, down [m]
                                               3..5  velocity relative to the vehicle: north, east, down [m/s]
                                               6, 7  noise of position [m] and velocity [m/s], rms per axis
    "beacon"     number of the beacon, from 1  0     distance [m]
                                               1, 2  azimuth and elevation in body axes (FRD) [rad]
                                               3, 4  noise of distance [m] and of each angle [rad], rms
                                               5..7  position of the beacon: north, east, down [m]

`time_usec` is the time of the measurement. Azimuth is positive to the right of the nose, elevation positive towards the top of
the vehicle. The common dialect has no message for a measured relative position: FOLLOW_TARGET and LANDING_TARGET contain
commands to an autopilot, so a program must not receive them as measurements.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

from arena.wire.mavlink_frame import Buffer, Frame, parse_frames
from arena.wire.mavlink_ids import SENSORS_COMPONENT

DEBUG_FLOAT_ARRAY = 350
_NEIGHBOUR, _BEACON = b"neighbour", b"beacon"
_PAYLOAD = struct.Struct("<QH10s8f")
_COMPID_PLACE = 6  # in a MAVLink 2 frame

Triple = tuple[float, float, float]


class NeighbourMeasurement(NamedTuple):
    """Measured position and velocity of a neighbour relative to the vehicle.

    time_s: time of the measurement [s].  system_id: MAV_SYS_ID of the neighbour.
    pos: neighbour minus vehicle [m] [NED].  vel: the same of the velocities [m/s] [NED].
    pos_noise_m, vel_noise_m_s: rms per axis.
    """

    time_s: float
    system_id: int
    pos: Triple
    vel: Triple
    pos_noise_m: float
    vel_noise_m_s: float


class BeaconMeasurement(NamedTuple):
    """Measured distance and direction of a beacon.

    time_s: time of the measurement [s].  number: of the beacon in the YAML, from 1.  range_m: [m].
    azimuth: angle in the body's x-y plane from forward, positive to the right [rad] [FRD].
    elevation: angle above this plane, positive towards the top of the vehicle [rad] [FRD].
    range_noise_m, bearing_noise: rms of the distance [m] and of each angle [rad].  p_n: position of the beacon [m] [NED].
    """

    time_s: float
    number: int
    range_m: float
    azimuth: float
    elevation: float
    range_noise_m: float
    bearing_noise: float
    p_n: Triple


Measurement = NeighbourMeasurement | BeaconMeasurement


def measurement_payload(measurement: Measurement) -> bytes:
    """Return the payload of a DEBUG_FLOAT_ARRAY message that contains a measurement."""
    m = measurement
    if isinstance(m, NeighbourMeasurement):
        name, number = _NEIGHBOUR, m.system_id
        data = (*m.pos, *m.vel, m.pos_noise_m, m.vel_noise_m_s)
    else:
        name, number = _BEACON, m.number
        data = (m.range_m, m.azimuth, m.elevation, m.range_noise_m, m.bearing_noise, *m.p_n)
    return _PAYLOAD.pack(round(m.time_s * 1e6), number, name, *data)


def is_sensor_datagram(data: Buffer) -> bool:
    """Return whether a datagram begins with a message of the emulated relative sensors.

    Other datagrams need not be parsed.
    """
    return len(data) > _COMPID_PLACE and data[0] == 0xFD and data[_COMPID_PLACE] == SENSORS_COMPONENT


def measurements(datagram: Buffer, system_id: int) -> Iterator[Measurement]:
    """Yield the measurements of one vehicle's sensors in a datagram.

    system_id: MAV_SYS_ID of the vehicle.

    A frame with a value that is not finite is ignored.
    """
    for frame in parse_frames(datagram).frames:
        if frame.msgid != DEBUG_FLOAT_ARRAY or (frame.sysid, frame.compid) != (system_id, SENSORS_COMPONENT):
            continue
        found = _decode(datagram, frame)
        if found is not None:
            yield found


def _decode(datagram: Buffer, frame: Frame) -> Measurement | None:
    raw = bytes(datagram[frame.payload : frame.payload + frame.size])[: _PAYLOAD.size]
    time_us, number, name, *data = _PAYLOAD.unpack(raw.ljust(_PAYLOAD.size, b"\0"))
    name, time_s = name.rstrip(b"\0"), time_us * 1e-6
    if not all(math.isfinite(value) for value in data):
        return None
    a, b, c, d, e, f, g, h = data
    if name == _NEIGHBOUR:
        return NeighbourMeasurement(time_s, number, (a, b, c), (d, e, f), g, h)
    return BeaconMeasurement(time_s, number, a, b, c, d, e, (f, g, h)) if name == _BEACON else None
