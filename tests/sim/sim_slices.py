"""World slices with a profile of the tests' own, so that a change of `profiles/` changes no test."""

from __future__ import annotations

import copy
from typing import Any

PROFILE: dict[str, Any] = {
    "name": "test_quad",
    "mass_kg": 1.5,
    "inertia_kg_m2": [0.029, 0.031, 0.055],
    "radius_m": 0.275,
    "height_m": 0.10,
    "ground_clearance_m": 0.05,
    "num_rotors": 4,
    "rotors": [
        {"position_m": [0.13, 0.22, -0.02], "direction": "ccw"},
        {"position_m": [-0.13, -0.22, -0.02], "direction": "ccw"},
        {"position_m": [0.13, -0.22, -0.02], "direction": "cw"},
        {"position_m": [-0.13, 0.22, -0.02], "direction": "cw"},
    ],
    "moment_ratio_m": 0.06,
    "motor_up_s": 0.0125,
    "motor_down_s": 0.025,
    "thrust_curve": {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": None},
    "drag_kg_s": [0.0, 0.0, 0.0],
    "body_drag_kg_m": [0.0, 0.0, 0.0],
    "ground_effect": None,
    "sensors": {
        "imu": {
            "accel_noise_m_s2": 0.03,
            "accel_bias_m_s2": 0.05,
            "gyro_noise_rad_s": 0.003,
            "gyro_bias_rad_s": 0.003,
        },
        "baro": {"noise_m": 0.1},
        "mag": {"noise_gauss": 0.004},
        "gps": {
            "horizontal_noise_m": 0.8,
            "vertical_noise_m": 1.78,
            "velocity_noise_m_s": 0.08,
            "rate_hz": 10,
        },
    },
    "battery": {
        "cells": 3,
        "capacity_mah": 5100,
        "full_cell_v": 4.2,
        "empty_cell_v": 3.5,
        "resistance_ohm": 0.03,
        "idle_a": 0.5,
        "hover_a": 20.0,
    },
    "params": {},
}


def vehicle(name: str = "uav1", number: int = 1, **changes: Any) -> dict[str, Any]:
    """Return a vehicle of the slice. changes: keys of the profile go into the profile, others into the vehicle."""
    out: dict[str, Any] = {
        "name": name,
        "id": number,
        "profile": copy.deepcopy(PROFILE),
        "position": [0.0, 0.0, 0.0],
        "rpy": [0.0, 0.0, 0.0],
        "params": {},
    }
    for key, value in changes.items():
        (out["profile"] if key in PROFILE else out)[key] = value
    return out


def slice_of(*vehicles: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return {
        "name": "world",
        "address": "127.55.0.1",
        "seed": 1,
        "size_m": [12.0, 8.0, 5.0],
        "heading_deg": 0.0,
        "origin": None,
        "physics_hz": 500,
        "sensor_hz": 250,
        "speed": 1,
        "gui": False,
        "wind_m_s": [0.0, 0.0, 0.0],
        "vehicles": list(vehicles) or [vehicle()],
        **changes,
    }
