"""Land detector: when a vehicle counts as being in the air."""

from __future__ import annotations

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.kernels.land_detection import LandDetection


def detection(*, thrust: float, climbing: bool, landed: bool = True) -> LandDetection:
    """Return the land detector of one vehicle that stands still."""
    made = LandDetection(*(np.array([flag]) for flag in (landed, False, False, True, climbing)))
    made.force[:], made.thrust[:], made.sink[:] = GRAVITY_M_S2, thrust, np.nan
    made.z_vel_max[:], made.xy_vel_max[:], made.rot_max[:] = 0.25, 1.5, 0.35
    made.trigger_s[:], made.thr_min[:], made.thr_hover[:], made.land_speed[:] = 1.0, 0.12, 0.5, 0.7
    return made


def test_vehicle_is_landed_until_its_thrust_rises() -> None:
    """As PX4 v1.16: the setpoint to climb comes a second before the motors have spooled up."""
    before = detection(thrust=0.0, climbing=True)
    before.step(1.0)
    assert before.landed[0]
    lifting = detection(thrust=0.4, climbing=True)
    lifting.step(1.0)
    assert not lifting.landed[0]


def test_climbing_vehicle_with_low_thrust_does_not_become_landed() -> None:
    in_the_air = detection(thrust=0.0, climbing=True, landed=False)
    for now in np.arange(0.0, 5.0, 0.1):
        in_the_air.step(float(now))
    assert not in_the_air.landed[0]
