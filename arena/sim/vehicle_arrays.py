"""Rigid bodies of all vehicles as arrays. A step needs few numpy calls for any number of vehicles.

Optional values have defaults, so that a JSON configuration (slice) written by hand may omit them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.errors import InputError
from arena.geometry import quat_from_euler, quat_rotate
from arena.portable_math import cos, sin

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Rigid bodies of V vehicles and their start positions.

    ids: system ids
    profiles: profiles of the vehicles
    mass: [kg] (V,)
    inertia: moments of inertia about the body axes [kg m2] (V, 3)
    radius, height: size of the collision cylinder [m] (V,)
    origin_height: height of the body origin above the vehicle's lowest point [m] (V,)
    start_p_n: start position of the body origin [m] [NED] (V, 3)
    start_q_nb: start attitude [-] wxyz (V, 4)
    """

    names: tuple[str, ...]
    ids: tuple[int, ...]
    profiles: tuple[dict[str, Any], ...]
    mass: Array
    inertia: Array
    radius: Array
    height: Array
    origin_height: Array
    start_p_n: Array
    start_q_nb: Array

    @property
    def size(self) -> int:
        """Number of vehicles in the fleet."""
        return len(self.names)


def read_fleet(vehicles: Sequence[dict[str, Any]]) -> Fleet:
    """Return the bodies of the configured `vehicles`. Raises InputError if no vehicle is configured."""
    if not vehicles:
        raise InputError("vehicles: got an empty list, expected at least one vehicle")
    profiles = tuple(v["profile"] for v in vehicles)
    origin_height = np.array(
        [p.get("ground_clearance_m", float(p["height_m"]) / 2.0) for p in profiles], float
    )
    start_q_nb = quat_from_euler([v.get("rpy", (0.0, 0.0, 0.0)) for v in vehicles])
    return Fleet(
        names=tuple(str(v["name"]) for v in vehicles),
        ids=tuple(int(v["id"]) for v in vehicles),
        profiles=profiles,
        mass=np.array([p["mass_kg"] for p in profiles], float),
        inertia=np.array([p["inertia_kg_m2"] for p in profiles], float),
        radius=np.array([p["radius_m"] for p in profiles], float),
        height=np.array([p["height_m"] for p in profiles], float),
        origin_height=origin_height,
        start_p_n=_start_positions(vehicles, start_q_nb, profiles, origin_height),
        start_q_nb=start_q_nb,
    )


def _start_positions(
    vehicles: Sequence[dict[str, Any]],
    q_nb: Array,
    profiles: tuple[dict[str, Any], ...],
    origin_height: Array,
) -> Array:
    """Return the start positions of the body origins [m] [NED] (V, 3).

    The configuration gives the position of each vehicle's lowest point.
    """
    p_n = np.array([v.get("position", (0.0, 0.0, 0.0)) for v in vehicles], float)
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    for i, profile in enumerate(profiles):
        bottom, radius = origin_height[i], float(profile["radius_m"])
        rims = [
            np.stack(
                [
                    radius * cos(angle),
                    radius * sin(angle),
                    np.full_like(angle, z),
                ],
                axis=-1,
            )
            for z in (bottom, bottom - float(profile["height_m"]))
        ]
        p_n[i, 2] -= quat_rotate(q_nb[i], np.concatenate(rims))[:, 2].max()
    return p_n
