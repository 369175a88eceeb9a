"""Camera positions of a film, from the text of the option `--camera`. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arena.errors import InputError
from arena.geometry import Array
from arena.render.camera import Camera, axes_of, distance_to_see, fit, look_at
from arena.render.tracks import Track, at

CORNER = (215.0, 25.0)
DIRECTIONS = {
    "corner": CORNER,
    "north": (0.0, 16.0),
    "east": (90.0, 16.0),
    "south": (180.0, 16.0),
    "west": (270.0, 16.0),
    "top": (180.0, 90.0),
}
"""Name of a fixed camera -> (azimuth, elevation) [deg], as in `arena.render.camera.axes_of`."""
EXPECTED = f"{', '.join(DIRECTIONS)}, orbit, follow:VEHICLE, or AZIMUTH,ELEVATION in degrees"
_TURN_S = 36.0  # film time of one turn of `orbit`
_ORBIT_ELEVATION_DEG = 22.0
_AROUND_M = 0.45  # free space around the flown volume that stays visible
_FOLLOW_M = 3.2  # distance of a camera that follows a vehicle
_SMOOTH_S = 1.0


@dataclass(frozen=True, kw_only=True)
class View:
    """Position and motion of the camera, as described by `--camera`.

    azimuth_deg, elevation_deg: direction from the room to the camera.
    orbit: the camera turns around the room.  follow: name of the vehicle that it follows; "" for none.
    """

    azimuth_deg: float = CORNER[0]
    elevation_deg: float = CORNER[1]
    orbit: bool = False
    follow: str = ""


def parse_view(text: str) -> View:
    """Parse the text of `--camera`, such as `south`, `follow:uav1` or `200,15`. Raises InputError.

    `200,15` is azimuth and elevation in degrees.
    """
    if text in DIRECTIONS:
        return View(azimuth_deg=DIRECTIONS[text][0], elevation_deg=DIRECTIONS[text][1])
    if text == "orbit":
        return View(orbit=True, elevation_deg=_ORBIT_ELEVATION_DEG)
    if match := re.fullmatch(r"follow:(.+)", text):
        return View(follow=match[1])
    if match := re.fullmatch(r"(-?\d+(?:\.\d+)?),(-?\d+(?:\.\d+)?)", text):
        azimuth, elevation = float(match[1]), float(match[2])
        if -5.0 <= elevation <= 90.0:
            return View(azimuth_deg=azimuth, elevation_deg=elevation)
        raise InputError(f"--camera {text}: got an elevation of {elevation:g} degrees, expected -5 to 90")
    raise InputError(f"--camera {text}: expected {EXPECTED}")


def flown_volume(tracks: Sequence[Track], start_s: float, end_s: float) -> Array:
    """Return the box from the floor up that contains all vehicles between two times [m] [NED] (8, 3).

    The result is the corners of the box.
    """
    points = np.concatenate([_between(t, start_s, end_s) for t in tracks])
    low, high = points.min(axis=0) - _AROUND_M, points.max(axis=0) + _AROUND_M
    ranges = ((low[0], high[0]), (low[1], high[1]), (low[2], max(0.0, high[2] - _AROUND_M)))
    return np.array([(n, e, d) for n in ranges[0] for e in ranges[1] for d in ranges[2]])


def _between(track: Track, start_s: float, end_s: float) -> Array:
    inside = (track.t >= start_s) & (track.t <= end_s)
    return np.concatenate([track.p_n[inside], at(track, np.array([start_s, end_s])).p_n])


def cameras(
    view: View, tracks: Sequence[Track], times: Array, speed: float, size: tuple[int, int]
) -> list[Camera]:
    """Return the camera of every picture. A camera that does not move is a single shared object.

    times: time of the pictures on the film's clock [s] (f,).  speed: flight seconds per second of film.
    size: width and height [px].  Raises InputError if the vehicle to follow does not exist.
    """
    if view.follow:
        return _following(view, tracks, times, size)
    volume = flown_volume(tracks, float(times[0]), float(times[-1]))
    if view.orbit:
        return _orbit(view, volume, (times - times[0]) / speed, size)
    return [fit(volume, view.azimuth_deg, view.elevation_deg, size)] * len(times)


def _orbit(view: View, volume: Array, film_s: Array, size: tuple[int, int]) -> list[Camera]:
    centre = volume.mean(axis=0)
    around = [axes_of(azimuth, view.elevation_deg) for azimuth in range(0, 360, 5)]
    distance = max(distance_to_see(volume, centre, axes, size) for axes in around)
    angles = view.azimuth_deg + 360.0 * film_s / _TURN_S
    positions = [centre - distance * axes_of(float(a), view.elevation_deg)[2] for a in angles]
    return [look_at(eye, centre, size) for eye in positions]


def _following(view: View, tracks: Sequence[Track], times: Array, size: tuple[int, int]) -> list[Camera]:
    found = next((t for t in tracks if t.name == view.follow), None)
    if found is None:
        names = ", ".join(t.name for t in tracks)
        raise InputError(
            f"--camera follow:{view.follow}: no such vehicle in this film, expected one of {names}"
        )
    around = np.linspace(-_SMOOTH_S, _SMOOTH_S, 21)
    places = np.stack([at(found, times + dt).p_n for dt in around]).mean(axis=0)
    back = _FOLLOW_M * axes_of(view.azimuth_deg, view.elevation_deg)[2]
    return [look_at(place - back, place, size) for place in places]
