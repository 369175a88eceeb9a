"""Vehicle states from truth and telemetry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arena.smoke.flying.observation import VehicleStates
from arena.wire.telemetry import Telemetry
from arena.wire.telemetry_values import HeartbeatState, Local
from arena.wire.truth_page import Truth

PROFILE = {"height_m": 0.1, "radius_m": 0.25}


def truth(height_m: float, roll: float = 0.0, motors: float = 0.5) -> Truth:
    """Return the truth of one vehicle whose origin is at this height [m]."""
    zero = np.zeros((1, 3))
    q = np.array([[np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0]])
    return Truth(
        time_s=1.0,
        p_n=np.array([[0.0, 0.0, -height_m]]),
        q_nb=q,
        v_n=zero,
        omega_b=zero,
        accel_b=zero,
        motors=np.full((1, 4), motors),
    )


def state_of(states: VehicleStates, at: Truth, telemetry: Telemetry | None = None, now: float = 1.0) -> Any:
    return states.update(at, {"a": telemetry or Telemetry(1)}, {}, now)["a"]


def test_height_is_that_of_the_lowest_point_of_a_tilted_cylinder():
    states = VehicleStates([{"name": "a", "profile": PROFILE}])
    assert state_of(states, truth(1.05)).height_m == pytest.approx(1.0)
    leaning = state_of(states, truth(1.0, roll=0.5))
    assert leaning.height_m == pytest.approx(1.0 - 0.05 * np.cos(0.5) - 0.25 * np.sin(0.5))
    assert leaning.tilt_rad == pytest.approx(0.5)
    assert state_of(states, truth(0.25, roll=np.pi / 2)).height_m == pytest.approx(
        0.0, abs=1e-9
    )  # on its side


def test_airborne_has_a_hysteresis():
    states = VehicleStates([{"name": "a", "profile": PROFILE}])
    flown = [state_of(states, truth(0.05 + h)).airborne for h in (0.0, 0.08, 0.12, 0.08, 0.04, 0.02, 0.08)]
    assert flown == [False, False, True, True, True, False, False]


def test_old_telemetry_is_unknown_and_still_rotors_are_disarmed():
    states, telemetry = VehicleStates([{"name": "a", "profile": PROFILE}]), Telemetry(1)
    telemetry.heartbeat = HeartbeatState(received_at=1.0, mode="OFFBOARD", armed=True)
    telemetry.local = Local(received_at=1.0, boot_s=1.0, pos=np.array([1.0, 2.0, 3.0]), vel=np.zeros(3))
    fresh = state_of(states, truth(1.0), telemetry, now=2.0)
    assert (fresh.mode, fresh.armed, fresh.est_p_n, fresh.landed) == ("OFFBOARD", True, (1.0, 2.0, 3.0), None)
    stale = state_of(states, truth(1.0), telemetry, now=2.02)
    assert (stale.mode, stale.armed, stale.est_p_n) == ("", None, None)
    assert state_of(states, truth(1.0, motors=0.0), telemetry, now=2.02).armed is False
    assert state_of(states, truth(1.0, motors=0.0), telemetry, now=2.0).armed is True  # telemetry comes first
