"""Poses of vehicles, rotors and setpoints in the axes of the page: world axes (z up) and FLU bodies. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arena.geometry import q_wf_from_q_nb, quat_multiply, quat_rotate, world_from_ned
from arena.live_view.fleet import FleetSnapshot

Array = NDArray[np.float64]

HIDDEN_M = -1000.0
"""Height at which things without a known position are drawn, out of sight [m]."""
TURN_PER_FRAME = 1.2
"""Largest turn of a rotor between two pictures [rad]. With more than a quarter turn, rotors would seem to turn backwards."""


def world_positions(p_n: Array) -> Array:
    """Convert positions p_n [m] [NED] (N, 3) to world axes [m] (N, 3).

    Unknown positions are placed far below the floor, where nobody sees them.
    """
    known = np.isfinite(p_n).all(axis=-1, keepdims=True)
    return np.where(known, world_from_ned(np.where(known, p_n, 0.0)), (0.0, 0.0, HIDDEN_M))


def world_attitudes(q_nb: Array) -> Array:
    """Convert attitude quaternions from FRD in NED to FLU in world axes (z up). wxyz (N, 4).

    Unknown attitudes are level.
    """
    known = np.isfinite(q_nb).all(axis=-1, keepdims=True)
    return q_wf_from_q_nb(np.where(known, q_nb, (1.0, 0.0, 0.0, 0.0)))


def rotor_poses(p_w: Array, q_wf: Array, places_f: Array, angles: Array) -> tuple[Array, Array]:
    """Return positions [m] (N * R, 3) and attitudes wxyz (N * R, 4) of all rotors in world axes.

    p_w, q_wf: vehicles (N, 3), (N, 4).  places_f: rotors in the body [m] [FLU] (R, 3).  angles: [rad] (N, R).
    """
    n, rotors = angles.shape
    q = np.repeat(q_wf, rotors, axis=0)
    offsets = quat_rotate(q, np.tile(places_f, (n, 1)))
    half = 0.5 * angles.reshape(-1)
    turn = np.zeros((n * rotors, 4))
    turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
    return np.repeat(p_w, rotors, axis=0) + offsets, quat_multiply(q, turn)


def rotor_turns(motors: Array, directions: Array) -> Array:
    """Return the angle by which each drawn rotor turns until the next picture [rad] (N, R).

    motors: output 0..1 [-] (N, R); NaN stands still.  directions: +1 counter-clockwise, -1 clockwise, seen from above (R,).
    """
    speed = np.sqrt(np.clip(np.nan_to_num(motors), 0.0, 1.0))
    return np.asarray(TURN_PER_FRAME * speed * directions)


def setpoint_positions(fleet: FleetSnapshot) -> Array:
    """Return the position setpoints to draw [m] [NED] (N, 3); NaN for a vehicle without one.

    An axis without a position setpoint gets the position of the vehicle. A vehicle that is not armed has NaN, too.
    """
    known = np.isfinite(fleet.set_p_n)
    found = np.where(known, fleet.set_p_n, fleet.p_n)
    armed = np.array([a is True for a in fleet.armed])
    return np.where((known.any(axis=1) & armed)[:, None], found, math.nan)


def follows_program(fleet: FleetSnapshot) -> tuple[bool, ...]:
    """Return for each vehicle whether a user program flies it: it is armed and in OFFBOARD mode."""
    return tuple(a is True and m == "OFFBOARD" for a, m in zip(fleet.armed, fleet.modes, strict=True))


def path_segments(paths: Sequence[Array]) -> Array:
    """Return the line segments of all planned paths [m] [world axes] (S, 2, 3).

    Without a path, there is one segment that nobody can see.

    paths: [m] [NED] (k, 3) each.
    """
    pieces = [np.stack([p[:-1], p[1:]], axis=1) for p in paths if len(p) > 1]
    if not pieces:
        return np.full((1, 2, 3), HIDDEN_M)
    return world_from_ned(np.concatenate(pieces))
