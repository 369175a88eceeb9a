"""Formation control: each follower keeps its place relative to its neighbours.

For vehicle i with n neighbours j:

    v_set = v_i + b mean_j(v_ij - d'_ij) + k mean_j(r_ij - d_ij)

r_ij and v_ij are the measured position and velocity of neighbour j relative to vehicle i, d_ij the desired relative position
and d'_ij its rate. With b = 1 the vehicle takes over the neighbours' mean velocity and corrects its place in proportion to the error.
It is the consensus law for agents with a velocity loop: W. Ren and R. Beard, "Distributed Consensus in Multi-vehicle
Cooperative Control", Springer 2008, chapters 3 and 4.

`formation_reference` is for agents whose input is a force (double integrators, chapter 4 there). With `PositionPid` it gives

    a = a_ref + sum_j [k_p (r_ij - d_ij) + k_d (v_ij - d'_ij) + k_i integral(r_ij - d_ij) dt]

a_ref is the planned acceleration of the vehicle: that of the leader plus that of its place in the formation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arena.geometry import Array
from arena.portable_math import norm
from arena.trajectories.trajectory import Reference


@dataclass(frozen=True, kw_only=True)
class FormationLaw:
    """Controller that computes the velocity setpoint of one follower in a formation.

    position_gain: k [1/s].  velocity_gain: b [-], above 0 to 1.  max_speed_m_s: largest speed of the setpoint [m/s].
    """

    position_gain: float = 1.0
    velocity_gain: float = 1.0
    max_speed_m_s: float = 2.0

    def velocity(
        self,
        rel_pos: ArrayLike,
        rel_vel: ArrayLike,
        wanted_pos: ArrayLike,
        vel: ArrayLike,
        wanted_vel: ArrayLike | None = None,
    ) -> Array:
        """Return the velocity setpoint of the follower [m/s] [NED] (3,).

        rel_pos, rel_vel: measured position [m] and velocity [m/s] of each neighbour relative to the vehicle [NED] (n, 3).
        wanted_pos: desired relative position of each neighbour [m] [NED] (n, 3).
        wanted_vel: its rate [m/s] (n, 3); None: a formation of constant shape.  vel: the vehicle's own velocity [m/s] [NED] (3,).
        """
        relative, speeds = (
            np.asarray(rel_pos, float).reshape(-1, 3),
            np.asarray(rel_vel, float).reshape(-1, 3),
        )
        wanted = np.asarray(wanted_pos, float).reshape(-1, 3)
        rate = np.zeros_like(wanted) if wanted_vel is None else np.asarray(wanted_vel, float).reshape(-1, 3)
        moving = np.asarray(vel, float) + self.velocity_gain * (speeds - rate).mean(axis=0)
        found: Array = moving + self.position_gain * (relative - wanted).mean(axis=0)
        size = norm(found)
        return found * (self.max_speed_m_s / size) if size > self.max_speed_m_s else found


def formation_reference(
    rel_pos: ArrayLike,
    rel_vel: ArrayLike,
    wanted_pos: ArrayLike,
    wanted_vel: ArrayLike,
    acc: ArrayLike,
    yaw: float = 0.0,
) -> Reference:
    """Return the reference for `PositionPid.update` with which a follower keeps its place in the formation.

    The reference is relative to the follower: call `PositionPid.update` with zeros as position and velocity.

    rel_pos, rel_vel: measured position [m] and velocity [m/s] of each neighbour relative to the vehicle [NED] (n, 3).
    wanted_pos, wanted_vel: desired relative position [m] and its rate [m/s] [NED] (n, 3).
    acc: planned acceleration of the vehicle [m/s2] [NED] (3,).  yaw: [rad].
    """
    errors = [
        np.asarray(measured, float).reshape(-1, 3) - np.asarray(wanted, float).reshape(-1, 3)
        for measured, wanted in ((rel_pos, wanted_pos), (rel_vel, wanted_vel))
    ]
    return Reference(
        pos=errors[0].sum(axis=0), vel=errors[1].sum(axis=0), acc=np.asarray(acc, float), yaw=yaw
    )
