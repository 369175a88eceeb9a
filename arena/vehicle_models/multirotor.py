"""Vehicle class multirotor: three to eight fixed rotors that push along the body's -z axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from arena.vehicle_models.model import CrashLimits, Dynamics, Profile
from arena.vehicle_models.rotor_geometry import actuator_effect

if TYPE_CHECKING:
    from arena.vehicle_models.model import Array

LEAST_EFFECT = 0.05  # a smaller singular value of the scaled effectiveness matrix counts as 0
_QUADROTOR = 2
_MAV_TYPES = {6: 13, 8: 14}  # MAV_TYPE_HEXAROTOR, MAV_TYPE_OCTOROTOR


class Multirotor:
    """Multirotor with the profile's rotor geometry.

    PX4 flies it with a quadrotor airframe, whose rotor geometry, outputs and MAV_TYPE the startup parameters replace.
    """

    name = "multirotor"
    px4_sim_model = "none_iris"
    px4_autostart = 10016
    crash_limits = CrashLimits(touchdown_m_s=1.5, tilt_rad=math.radians(60.0))

    def mav_type(self, actuators: int) -> int:
        """Return the MAV_TYPE: hexarotor for 6 rotors, octorotor for 8 rotors, otherwise quadrotor.

        MAVLink has no type for 5 or 7 rotors, and PX4 v1.16 flies only types that it knows as multirotors.
        """
        return _MAV_TYPES.get(actuators, _QUADROTOR)

    def control_problem(self, actuators: Sequence[Mapping[str, Any]]) -> str:
        """Return why the rotors cannot control roll, pitch, yaw and thrust independently, or "" if they can.

        Each column of the effectiveness matrix is scaled to 1, so the rank does not depend on units.
        """
        rank = controlled_axes([actuator_effect(r, moment_ratio_m=1.0) for r in actuators])
        if rank == 4:
            return ""
        return (
            f"its {len(actuators)} rotors control only {rank} of roll, pitch, yaw and thrust independently (rank of"
            " the effectiveness matrix), expected 4. Use four rotors or more, not all on one line, with rotors of"
            " both directions on each side"
        )

    def allocation(self, actuators: Sequence[Mapping[str, Any]]) -> Array:
        """Return the control allocation: the weights of roll, pitch and yaw torque for each rotor (R, 3).

        actuators: rotors with `position_m` [m] [FRD] and `direction` (cw or ccw, seen from above)

        For a symmetric quadrotor X: u = thrust +- 0.707 roll +- 0.707 pitch +- yaw, as in PX4.
        """
        import numpy as np

        from arena.portable_math import right_inverse

        effect = np.stack([actuator_effect(r, moment_ratio_m=1.0)[:3] for r in actuators])
        inverse = right_inverse(np.column_stack([effect, np.ones(len(effect))]).T)[:, :3]
        count = max(int((np.abs(inverse[:, 0]) > 1e-6).sum()), 1)
        tilt_scale = max(float(np.sqrt((inverse[:, a] ** 2).sum() / (count / 2.0))) for a in (0, 1))
        scale = np.array([tilt_scale, tilt_scale, float(np.abs(inverse[:, 2]).max())])
        return np.asarray(inverse / np.maximum(scale, 1e-9))

    def dynamics(self, profiles: Sequence[Profile], *, step_s: float) -> Dynamics:
        """Return the rotor dynamics. Raises InputError if a rotor's direction is not cw or ccw."""
        from arena.vehicle_models.multirotor_dynamics import Rotors

        return Rotors(profiles, step_s=step_s)


def controlled_axes(effect: Sequence[Sequence[float]]) -> int:
    """Return how many of roll, pitch, yaw and thrust the rotors control independently.

    It is the rank of the effectiveness matrix.

    effect: torque x, y, z and force z of each rotor. The rank is the number of singular values above LEAST_EFFECT of the
    matrix with its columns scaled to 1.

    These are the eigenvalues above the square of LEAST_EFFECT of the product of the transposed matrix and the matrix. By
    Sylvester's law of inertia, as many pivots are positive in the elimination of this product minus that square.
    Plain floats, because numpy's import takes longer than the check of an arena.
    """
    scale = [max(1e-9, *(abs(x) for x in column)) for column in zip(*effect, strict=True)]
    columns = [[x / s for x in column] for column, s in zip(zip(*effect, strict=True), scale, strict=True)]
    a = [[sum(x * y for x, y in zip(c, d, strict=True)) for d in columns] for c in columns]
    size = len(a)
    for i in range(size):
        a[i][i] -= LEAST_EFFECT**2
    for i in range(size):
        pivot = a[i][i] or 1e-12
        for row in range(i + 1, size):
            for column in range(i + 1, size):
                a[row][column] -= a[row][i] * a[i][column] / pivot
    return sum(a[i][i] > 0.0 for i in range(size))
