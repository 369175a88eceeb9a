"""Whole flights of the built-in autopilot: with the Python source of the kernels, with many rotors, at the limit of the thrust."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flight import PROFILE, Flight, with_rotors
from whole_flight import take_off

from tests.kernels.kernel_versions import needs_compiled

MOST_CLIMB_M_S = 8.1
"""Highest climb rate with a limit of 8 m/s. An anti-windup that compares the limited thrust lets the integral wind up: 8.4 m/s."""


def flown(interpreted: str) -> str:
    script = Path(__file__).with_name("whole_flight.py")
    environment = {**os.environ, "ARENA_INTERPRETED": interpreted}
    done = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()[-1]


@needs_compiled
def test_compiled_and_interpreted_kernels_fly_the_same_flight() -> None:
    compiled = flown("0")
    height, _, _ = compiled.partition(" m, ")
    assert float(height) > 0.5
    assert flown("1") == compiled


@pytest.mark.parametrize("rotors", [6, 8])
def test_all_rotors_of_a_hexarotor_and_an_octorotor_turn_and_are_reported(
    rotors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flight.PROFILE", with_rotors(rotors))
    flight = Flight(1)
    flight.motors = np.zeros((1, rotors))
    take_off(flight, (0.0, 0.0, -1.5))
    flight.run(8.0, lambda f: f.setpoint(0, (0.0, 0.0, -1.5)))
    assert abs(flight.position(0)[2] + 1.5) < 0.1
    assert flight.motors.shape == (1, rotors) and flight.motors.min() > 0.1
    (*_, last) = [m for m in flight.received[0] if m.get_type() == "SERVO_OUTPUT_RAW"]
    outputs = [getattr(last, f"servo{k + 1}_raw") for k in range(8)]
    assert [pwm > 1100 for pwm in outputs] == [k < rotors for k in range(8)], outputs


def test_saturated_thrust_does_not_wind_up_the_vertical_integral(monkeypatch: pytest.MonkeyPatch) -> None:
    heavy = {**PROFILE, "mass_kg": 1.8 * PROFILE["mass_kg"]}
    monkeypatch.setattr("flight.PROFILE", heavy)
    flight = Flight(1, params={"MPC_Z_VEL_MAX_UP": 8.0}, size_m=[40.0, 40.0, 90.0])
    fastest = 0.0

    def climb(f: Flight) -> None:
        nonlocal fastest
        f.setpoint(0, (12.0, 0.0, -60.0))
        fastest = max(fastest, -float(f.world.truth().v_n[0][2]))

    take_off(flight, (12.0, 0.0, -60.0))
    flight.until(lambda f: f.position(0)[2] < -50.0, 30, climb)
    assert 7.0 < fastest < MOST_CLIMB_M_S, fastest
