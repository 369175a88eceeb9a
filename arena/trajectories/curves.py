"""Closed curves that begin and end at rest: Lissajous figures and circles.

A curve is a function of its phase. At the beginning and at the end, the phase rate rises and falls smoothly, so that
velocity and acceleration have no steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arena.errors import InputError
from arena.geometry import Array
from arena.portable_math import cos, sin
from arena.trajectories.trajectory import Reference, from_rest


@dataclass(frozen=True)
class _Phase:
    """Phase of a closed curve over time: accelerates from rest to a constant rate, and back to rest.

    total: phase at the end [rad].  rate: largest phase rate [rad/s].  ramp_s: duration of the rise and of the fall [s].
    """

    total: float
    rate: float
    ramp_s: float

    @property
    def duration_s(self) -> float:
        # the mean rate of a ramp is half of the largest rate, because the rise is symmetric
        return self.total / self.rate + self.ramp_s

    def at(self, t: float) -> tuple[float, float, float]:
        """Return phase [rad], phase rate [rad/s] and phase acceleration [rad/s2] at time `t` [s]."""
        end = self.duration_s
        if t <= 0.0 or t >= end:
            return (0.0 if t <= 0.0 else self.total), 0.0, 0.0
        left = end - t
        if t < self.ramp_s:
            share, slope, _ = from_rest(t, self.ramp_s)
            return self.rate * _area(t, self.ramp_s), self.rate * share, self.rate * slope
        if left < self.ramp_s:
            share, slope, _ = from_rest(left, self.ramp_s)
            return self.total - self.rate * _area(left, self.ramp_s), self.rate * share, -self.rate * slope
        return self.rate * (t - self.ramp_s / 2.0), self.rate, 0.0


def _area(t: float, rise_s: float) -> float:
    """Return the integral of the function `from_rest` from time 0 to time `t` [s].

    `from_rest` rises smoothly from 0 to 1 within `rise_s` [s].
    """
    u = t / rise_s
    return rise_s * u**4 * (2.5 - 3.0 * u + u * u)


class Lissajous:
    """Lissajous figure: a sine on each axis, with its own amplitude, frequency and phase.

    With the phase s of the curve, the offset on axis k is
        amplitude_k sin(frequency_k s + phase_k) - amplitude_k sin(phase_k)

    The vehicle begins and ends at `start` if the frequencies are integers.
    start: position at the beginning [m] [NED] (3,).  amplitude: [m] [NED] (3,).
    frequency: multiples of the lap frequency [-] (3,), for example (1, 2, 0) for a figure of eight.  phase: [rad] (3,).
    lap_s: time of one lap at full speed [s].  laps: number of laps.  ramp_s: time to reach full speed [s]; None: half a lap.
    yaw: [rad].
    """

    def __init__(
        self,
        start: ArrayLike,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        *,
        phase: ArrayLike = (0.0, 0.0, 0.0),
        lap_s: float,
        laps: float = 1.0,
        ramp_s: float | None = None,
        yaw: float = 0.0,
    ) -> None:
        _check("lap_s", lap_s)
        _check("laps", laps)
        self._start, self._amplitude = _vector(start), _vector(amplitude)
        self._frequency, self._phase, self._yaw = _vector(frequency), _vector(phase), yaw
        ramp_s = lap_s / 2.0 if ramp_s is None else _check("ramp_s", ramp_s)
        self._motion = _Phase(2.0 * math.pi * laps, 2.0 * math.pi / lap_s, min(ramp_s, laps * lap_s))

    @property
    def duration_s(self) -> float:
        return self._motion.duration_s

    def at(self, t: float) -> Reference:
        s, rate, acceleration = self._motion.at(t)
        w, a = self._frequency, self._amplitude
        angle = w * s + self._phase
        slope, bend = a * w * cos(angle), -a * w * w * sin(angle)
        return Reference(
            pos=self._start + a * (sin(angle) - sin(self._phase)),
            vel=slope * rate,
            acc=bend * rate * rate + slope * acceleration,
            yaw=self._yaw,
        )


class Circle:
    """Horizontal circle at constant height.

    start: position at the beginning [m] [NED] (3,).  radius_m: [m].
    bearing: direction from `start` to the centre [rad], clockwise from north.
    lap_s: time of one lap at full speed [s].  laps: number of laps, negative for anticlockwise seen from above.
    ramp_s: time to reach full speed [s]; None: half a lap.
    nose: "fixed" keeps `yaw` [rad]; "tangent" points along the way; "centre" points to the centre.
    """

    def __init__(
        self,
        start: ArrayLike,
        radius_m: float,
        *,
        bearing: float = 0.0,
        lap_s: float,
        laps: float = 1.0,
        ramp_s: float | None = None,
        yaw: float = 0.0,
        nose: str = "fixed",
    ) -> None:
        if nose not in ("fixed", "tangent", "centre"):
            raise InputError(f"circle: nose: got {nose!r}, expected fixed, tangent or centre")
        _check("lap_s", lap_s)
        _check("laps", abs(laps))
        self._centre = _vector(start) + radius_m * np.array([math.cos(bearing), math.sin(bearing), 0.0])
        self._radius, self._first, self._sign = radius_m, bearing + math.pi, math.copysign(1.0, laps)
        self._yaw, self._nose = yaw, nose
        ramp_s = lap_s / 2.0 if ramp_s is None else _check("ramp_s", ramp_s)
        self._motion = _Phase(
            2.0 * math.pi * abs(laps), 2.0 * math.pi / lap_s, min(ramp_s, abs(laps) * lap_s)
        )

    @property
    def duration_s(self) -> float:
        return self._motion.duration_s

    def at(self, t: float) -> Reference:
        s, rate, acceleration = self._motion.at(t)
        angle = self._first + self._sign * s
        outward = np.array([math.cos(angle), math.sin(angle), 0.0])
        along = self._sign * np.array([-math.sin(angle), math.cos(angle), 0.0])
        turning = {"fixed": None, "tangent": angle + self._sign * math.pi / 2.0, "centre": angle + math.pi}[
            self._nose
        ]
        return Reference(
            pos=self._centre + self._radius * outward,
            vel=self._radius * rate * along,
            acc=self._radius * (acceleration * along - rate * rate * outward),
            yaw=self._yaw if turning is None else math.remainder(turning, 2.0 * math.pi),
            yaw_rate=0.0 if turning is None else self._sign * rate,
        )


def _vector(values: ArrayLike) -> Array:
    found = np.asarray(values, float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InputError(f"trajectory: got {values!r}, expected three finite numbers: north, east, down")
    return found


def _check(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"trajectory: {name}: got {value!r}, expected a number above 0")
    return float(value)
