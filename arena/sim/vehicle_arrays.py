"""The bodies of the world slice's vehicles as arrays, so that one step costs few numpy calls whatever their number.

Optional figures have defaults, so that a slice written by hand may leave them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.errors import InputError
from arena.geometry import quat_from_euler, quat_rotate

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """V rigid bodies and where they start.

    ids: system ids
    profiles: as the slice carries them
    mass: [kg] (V,)
    inertia: about the body axes [kg m2] (V, 3)
    radius, height: of the collision cylinder [m] (V,)
    origin_height: of the body origin above its lowest point [m] (V,)
    start_p_n: body origin [m] [NED] (V, 3)
    start_q_nb: attitude [-] wxyz (V, 4)
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
        """Number of vehicles."""
        return len(self.names)


def read_fleet(vehicles: Sequence[dict[str, Any]]) -> Fleet:
    """Return the bodies of the slice's `vehicles`. Raises InputError when there is none."""
    if not vehicles:
        raise InputError("the world slice has no vehicles")
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
    """Return the body origins [m] [NED] (V, 3), from the slice's `position` of each vehicle's lowest point."""
    p_n = np.array([v.get("position", (0.0, 0.0, 0.0)) for v in vehicles], float)
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    for i, profile in enumerate(profiles):
        bottom, radius = origin_height[i], float(profile["radius_m"])
        rims = [
            np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, z)], axis=-1)
            for z in (bottom, bottom - float(profile["height_m"]))
        ]
        p_n[i, 2] -= quat_rotate(q_nb[i], np.concatenate(rims))[:, 2].max()
    return p_n
