"""GPS receiver: measures global position and velocity. Its position error varies slowly.

The position error is a Gauss-Markov process with a time constant of 60 s, as in the simulators that PX4 is
tested in. Position and velocity are rotated to true north by the arena's heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.geometry import globe_from_local
from arena.portable_math import exp
from arena.sim.sensors.sensor import Array, Channel, Motion, Sensor, Site
from arena.wire.hil import HilMessage, HilSender

_CORRELATION_S, _DEFAULT_RATE_HZ = 60.0, 10.0
_ACCURACY_CM, _SATELLITES = (80, 120), 14  # reported, horizontal and vertical


def _hil_message(sender: HilSender, time_usec: int, sensors: Mapping[str, Array], row: int) -> bytes:
    """Return the HIL_GPS message of a vehicle, with a 3D fix."""
    lat, lon, alt = (float(sensors[key][row]) for key in ("lat_deg", "lon_deg", "alt_m"))
    v_cm_s = [round(min(max(100.0 * x, -32768.0), 32767.0)) for x in sensors["v_true_n"][row].tolist()]
    place = (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3))
    return sender.gps(time_usec, place, _ACCURACY_CM, v_cm_s, _SATELLITES)


class Gps(Sensor):
    """GPS receivers of V vehicles: latitude, longitude [deg], altitude [m] (V,), velocity [m/s] (V, 3)."""

    stream = 2
    channels = (
        Channel(axes=2, noise="horizontal_noise_m", default_noise=0.8),
        Channel(axes=1, noise="vertical_noise_m", default_noise=1.8),
        Channel(axes=3, noise="velocity_noise_m_s", default_noise=0.1),
    )
    readings = ("lat_deg", "lon_deg", "alt_m", "v_true_n")
    on_request = True
    log_columns = ()
    hil = HilMessage(name="gps", every=25, reading="lat_deg", pack=_hil_message)

    def __init__(self, profiles: Sequence[Mapping[str, Any]], site: Site, period_s: float) -> None:
        self._origin, self._heading = site.origin, site.heading_rad
        rate_hz = np.array(
            [p.get("sensors", {}).get("gps", {}).get("rate_hz", _DEFAULT_RATE_HZ) for p in profiles], float
        )
        self._keep: Array = exp(-1.0 / (_CORRELATION_S * rate_hz))[:, None]
        self._error: Array | None = None  # of the position [m] (V, 3)
        self._lat, self._lon, self._alt = np.zeros((3, len(profiles)))

    def views(self, values: Array) -> dict[str, Array]:
        """Return the GPS fix: lat_deg, lon_deg, alt_m (V,) and v_true_n [m/s] (V, 3).

        v_true_n is the velocity in NED with true north, not the arena's north. Returns {} if the arena has no global origin.
        """
        if self._origin is None:
            return {}
        place = {"lat_deg": self._lat, "lon_deg": self._lon, "alt_m": self._alt}
        return {**place, "v_true_n": values[:, 3:]}

    def measure(self, values: Array, motion: Motion) -> None:
        """Write the next fix of every receiver to the readings."""
        if self._origin is None:
            return
        keep, fresh = self._keep, values[:, :3]
        error = self._error
        self._error = fresh.copy() if error is None else keep * error + np.sqrt(1.0 - keep**2) * fresh
        position = self._true_north(motion.p_n) + self._error
        values[:, 3:] += self._true_north(motion.v_n)
        origin, north, east = self._origin, position[:, 0], position[:, 1]
        self._lat[:], self._lon[:] = globe_from_local(origin.lat_deg, origin.lon_deg, north, east)
        self._alt[:] = origin.alt_m - position[:, 2]

    def _true_north(self, v_n: Array) -> Array:
        """Rotate vectors (V, 3) from the arena's axes to NED with true north.

        The arena's north is turned clockwise by `heading` from true north.
        """
        c, s = math.cos(self._heading), math.sin(self._heading)
        return np.stack([c * v_n[:, 0] - s * v_n[:, 1], s * v_n[:, 0] + c * v_n[:, 1], v_n[:, 2]], axis=-1)
