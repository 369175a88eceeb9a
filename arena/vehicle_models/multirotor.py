"""Vehicle class multirotor: three to eight fixed rotors that push along the body's -z axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.vehicle_models.model import Array, CrashLimits, Dynamics, Profile
from arena.vehicle_models.multirotor_dynamics import Rotors, actuator_effect


class Multirotor:
    """Multirotor with the rotor geometry of its profile. PX4 flies it with a quadrotor airframe, whatever the number of rotors."""

    name = "multirotor"
    mav_type = 2  # MAV_TYPE_QUADROTOR, which PX4's airframe reports whatever the number of rotors
    px4_sim_model = "none_iris"
    px4_autostart = 10016
    crash_limits = CrashLimits(touchdown_m_s=1.5, tilt_rad=math.radians(60.0))

    def allocation(self, actuators: Sequence[Mapping[str, Any]]) -> Array:
        """Return the control allocation: the weights of roll, pitch and yaw torque for each rotor (R, 3).

        actuators: rotors with `position_m` [m] [FRD] and `direction` (cw or ccw, seen from above)

        For a symmetric quadrotor X: u = thrust +- 0.707 roll +- 0.707 pitch +- yaw, as in PX4.
        """
        effect = np.stack([actuator_effect(r, moment_ratio_m=1.0)[:3] for r in actuators])
        inverse = np.linalg.pinv(np.column_stack([effect, np.ones(len(effect))]).T)[:, :3]
        count = max(int((np.abs(inverse[:, 0]) > 1e-6).sum()), 1)
        tilt_scale = max(float(np.sqrt((inverse[:, a] ** 2).sum() / (count / 2.0))) for a in (0, 1))
        scale = np.array([tilt_scale, tilt_scale, float(np.abs(inverse[:, 2]).max())])
        return np.asarray(inverse / np.maximum(scale, 1e-9))

    def dynamics(self, profiles: Sequence[Profile], *, step_s: float) -> Dynamics:
        """Return the rotor dynamics. Raises InputError if a rotor's direction is not cw or ccw."""
        return Rotors(profiles, step_s=step_s)
