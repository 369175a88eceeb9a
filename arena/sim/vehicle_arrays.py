"""The vehicles of the world slice as arrays over the fleet, so that a step costs a few numpy calls whatever
their number.

Each figure has a default, so that a slice written by hand may leave out what it does not care for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.geometry import quat_from_euler, quat_rotate
from arena.sim.ground import ground_table
from arena.thrust_curve import thrust_curve

Array = NDArray[np.float64]

_DIRECTION = {"ccw": 1.0, "cw": -1.0}
GRID = 1024


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """V vehicles with at most R rotors; absent rotors push nothing.

    mass [kg] (V,). inertia about the body axes [kg m2] (V, 3). radius, height of the collision cylinder [m]
    (V,); origin_height of the body origin above its lowest point [m] (V,). start_p_n: body origin [m] [NED]
    (V, 3); start_q_nb [-] wxyz (V, 4). wrench: thrusts (R,) -> torque x, y, z [N m] and force z [N], FRD,
    (V, 4, R). thrust: thrust of one rotor at GRID + 1 equally spaced commands from 0 to 1, at rest [N] (V,
    GRID + 1); speed_loss: fraction of it lost per m/s of airspeed [s/m] (V,). hover: the command that
    carries it at rest [-] (V,). tau_up, tau_down: rotor lag [s] (V, 1). drag: of the rotors at hover, force per
    airspeed along FRD [N s/m] (V, 3); body_drag: force per square of it [N s2/m2] (V, 3). per_weight: -1 / (mass g) [1/N]
    (V,). per_volt: supply of the rotors per volt of the battery [1/V], 0 where it does not matter (V,). ground: share of the
    thrust far from the floor, one table after the other (V * (CELLS + 1),); ground_scale: cells per metre of height
    [1/m] (V,); ground_reach: where it ends [m] (V,).
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
    wrench: Array
    thrust: Array
    speed_loss: Array
    hover: Array
    tau_up: Array
    tau_down: Array
    drag: Array
    body_drag: Array
    per_weight: Array
    per_volt: Array
    ground: Array
    ground_scale: Array
    ground_reach: Array

    @property
    def size(self) -> int:
        return len(self.names)

    @property
    def rotors(self) -> int:
        return int(self.wrench.shape[2])


def read_fleet(vehicles: list[dict[str, Any]]) -> Fleet:
    """vehicles: the slice's list. Raises InputError where a vehicle cannot be built."""
    if not vehicles:
        raise InputError("the world slice has no vehicles")
    profiles = tuple(v["profile"] for v in vehicles)
    most = max(len(p["rotors"]) for p in profiles)
    origin_height = _column(profiles, "ground_clearance_m", lambda p: float(p["height_m"]) / 2.0)
    start_q_nb = quat_from_euler([v.get("rpy", (0.0, 0.0, 0.0)) for v in vehicles])
    curves = [_curve(p) for p in profiles]
    grounds = [ground_table(p) for p in profiles]
    return Fleet(
        names=tuple(str(v["name"]) for v in vehicles),
        ids=tuple(int(v["id"]) for v in vehicles),
        profiles=profiles,
        mass=_column(profiles, "mass_kg"),
        inertia=np.array([p["inertia_kg_m2"] for p in profiles], float),
        radius=_column(profiles, "radius_m"),
        height=_column(profiles, "height_m"),
        origin_height=origin_height,
        start_p_n=_origin(vehicles, start_q_nb, profiles, origin_height),
        start_q_nb=start_q_nb,
        wrench=np.stack([_wrench(p, most) for p in profiles]),
        thrust=np.stack([table for table, _ in curves]),
        speed_loss=np.array([loss for _, loss in curves]),
        hover=np.array([_hover(p) for p in profiles]),
        tau_up=_column(profiles, "motor_up_s", lambda _: 0.0125)[:, None],
        tau_down=_column(profiles, "motor_down_s", lambda _: 0.025)[:, None],
        drag=np.array([p.get("drag_kg_s", (0.2, 0.2, 0.2)) for p in profiles], float),
        body_drag=np.array([p.get("body_drag_kg_m", (0.0, 0.0, 0.0)) for p in profiles], float),
        per_weight=-1.0 / (_column(profiles, "mass_kg") * GRAVITY_M_S2),
        per_volt=np.array([_per_volt(p) for p in profiles]),
        ground=np.concatenate([table for table, _, _ in grounds]),
        ground_scale=np.array([scale for _, scale, _ in grounds]),
        ground_reach=np.array([reach for _, _, reach in grounds]),
    )


def _column(rows: Any, key: str, default: Callable[[Any], float] | None = None) -> Array:
    return np.array([row[key] if key in row or default is None else default(row) for row in rows], float)


def _origin(
    vehicles: list[dict[str, Any]], q_nb: Array, profiles: tuple[dict[str, Any], ...], origin_height: Array
) -> Array:
    """The body origin above `position`, which is that of the lowest point, the vehicle leaning as it may [m]
    [NED] (V, 3).
    """
    p_n = np.array([v.get("position", (0.0, 0.0, 0.0)) for v in vehicles], float)
    for i, profile in enumerate(profiles):
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        bottom, radius = origin_height[i], float(profile["radius_m"])
        rims = [
            np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, z)], axis=-1)
            for z in (bottom, bottom - float(profile["height_m"]))
        ]
        p_n[i, 2] -= quat_rotate(q_nb[i], np.concatenate(rims))[:, 2].max()
    return p_n


def _wrench(profile: Mapping[str, Any], most: int) -> Array:
    """Each thrust pushes along -z of FRD at r: torque r x (0, 0, -T) = (-y T, x T, 0).

    A propeller that turns counter-clockwise seen from above is turned back by the air, and the body with it,
    clockwise: +z.
    """
    out = np.zeros((4, most))
    ratio = float(profile.get("moment_ratio_m", 0.016))
    for i, rotor in enumerate(profile["rotors"]):
        x, y, _ = rotor["position_m"]
        if rotor["direction"] not in _DIRECTION:
            raise InputError(f"rotor {i + 1}: direction: got {rotor['direction']!r}, expected cw or ccw")
        out[:, i] = -y, x, ratio * _DIRECTION[rotor["direction"]], -1.0
    return out


def _curve(profile: Mapping[str, Any]) -> tuple[Array, float]:
    """One rotor's thrust at each command of the grid [N] (GRID + 1,), and the fraction lost per m/s [s/m]."""
    curve = thrust_curve(profile["thrust_curve"])
    return curve.newtons(np.linspace(0.0, 1.0, GRID + 1)) / len(profile["rotors"]), 1.0 / curve.fade_speed_m_s


def _per_volt(profile: Mapping[str, Any]) -> float:
    nominal = profile.get("battery", {}).get("thrust_at_v")
    return 1.0 / float(nominal) if nominal else 0.0


def _hover(profile: Mapping[str, Any]) -> float:
    """The command that carries the vehicle at rest [-]."""
    return float(thrust_curve(profile["thrust_curve"]).command(float(profile["mass_kg"]) * GRAVITY_M_S2))
