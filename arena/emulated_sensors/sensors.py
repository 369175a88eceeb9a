"""Emulated sensors: what one vehicle measures of its neighbours and of beacons. Pure.

Positions and velocities of neighbours are in NED axes. Directions of beacons are in the body axes (FRD) of the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from arena.emulated_sensors.settings import Beacon, BeaconSettings, NeighbourSettings
from arena.emulated_sensors.states import State
from arena.geometry import quat_conj, quat_rotate
from arena.wire.relative_measurements import BeaconMeasurement, NeighbourMeasurement

_NEIGHBOURS, _BEACONS = 1, 2  # part of the seed


class SensorTimer:
    """Timer of a sensor with a fixed rate.

    Missed times are skipped. rate_hz: [Hz].
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_s, self._next_s = 1.0 / rate_hz, -math.inf

    def is_due(self, now: float) -> bool:
        """Return whether the sensor measures now. If so, set the time of the next measurement.

        now: [s].
        """
        if now < self._next_s - 1e-6:
            return False
        late = not 0.0 <= now - self._next_s < self._period_s
        self._next_s = (now if late else self._next_s) + self._period_s
        return True


class NeighbourSensor:
    """Sensor of one vehicle that measures positions and velocities of its neighbours.

    ids: MAV_SYS_ID of each neighbour, in the order of `settings.rows`.  seed: of the noise.  vehicle: MAV_SYS_ID of the vehicle.
    """

    def __init__(self, settings: NeighbourSettings, ids: Sequence[int], seed: int, vehicle: int) -> None:
        self.settings, self.timer = settings, SensorTimer(settings.rate_hz)
        self._ids = tuple(ids)
        self._random = [np.random.default_rng([seed, vehicle, _NEIGHBOURS, number]) for number in ids]

    def measure(self, own: State | None, others: Sequence[State | None]) -> Iterator[NeighbourMeasurement]:
        """Yield a measurement of each neighbour whose state is known.

        Nothing is measured while the vehicle's own state is unknown.

        own: state of the vehicle.  others: states of the neighbours, in the order of `settings.rows`.
        """
        s = self.settings
        for number, random, other in zip(self._ids, self._random, others, strict=True):
            # drawn also for an unknown state, so that a lost neighbour does not shift the later random numbers
            noise = random.normal(size=6).tolist()
            if own is None or other is None:
                continue
            pos = [b - a + s.position_noise_m * n for a, b, n in zip(own.p_n, other.p_n, noise, strict=False)]
            vel = [
                b - a + s.velocity_noise_m_s * n
                for a, b, n in zip(own.v_n, other.v_n, noise[3:], strict=True)
            ]
            yield NeighbourMeasurement(
                own.time_s,
                number,
                (pos[0], pos[1], pos[2]),
                (vel[0], vel[1], vel[2]),
                s.position_noise_m,
                s.velocity_noise_m_s,
            )


class BeaconSensor:
    """Sensor of one vehicle that measures distances and directions of beacons.

    seed: of the noise.  vehicle: MAV_SYS_ID of the vehicle.
    """

    def __init__(self, settings: BeaconSettings, seed: int, vehicle: int) -> None:
        self.settings, self.timer = settings, SensorTimer(settings.rate_hz)
        numbers = [beacon.number for beacon in settings.beacons]
        self._random = [np.random.default_rng([seed, vehicle, _BEACONS, number]) for number in numbers]

    def measure(self, own: State | None) -> Iterator[BeaconMeasurement]:
        """Yield a measurement of each beacon in range.

        Nothing is measured while the vehicle's own state is unknown. own: state of the vehicle.
        """
        for beacon, random in zip(self.settings.beacons, self._random, strict=True):
            noise = random.normal(size=3).tolist()
            if own is not None and math.dist(own.p_n, beacon.p_n) <= self.settings.max_range_m:
                yield self._measure(own, beacon, noise)

    def _measure(self, own: State, beacon: Beacon, noise: Sequence[float]) -> BeaconMeasurement:
        s = self.settings
        away_n = np.subtract(beacon.p_n, own.p_n)
        forward, right, down = quat_rotate(quat_conj(np.array(own.q_nb)), away_n).tolist()
        azimuth = math.atan2(right, forward) + s.bearing_noise * noise[1]
        return BeaconMeasurement(
            own.time_s,
            beacon.number,
            max(0.0, math.hypot(forward, right, down) + s.range_noise_m * noise[0]),
            math.remainder(azimuth, 2.0 * math.pi),
            math.atan2(-down, math.hypot(forward, right)) + s.bearing_noise * noise[2],
            s.range_noise_m,
            s.bearing_noise,
            beacon.p_n,
        )
