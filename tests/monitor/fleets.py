"""Snapshots of vehicles that tests make by hand."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from arena.constants import MAX_ROTORS
from arena.live_view import FleetSnapshot, Settings, Snapshot, VehicleSettings
from arena.live_view.settings import Rotor

CORNERS = ((0.13, 0.22, False), (-0.13, -0.2, False), (0.13, -0.22, True), (-0.13, 0.2, True))


def fleet(n=2, **changes):
    """Return armed vehicles in OFFBOARD, one metre above the floor and one metre apart."""
    p_n = np.stack([np.arange(n, dtype=float), np.zeros(n), np.full(n, -1.0)], axis=1)
    level, zero = np.tile((1.0, 0, 0, 0), (n, 1)), np.zeros((n, 3))
    given = {
        "names": tuple(f"uav{i + 1}" for i in range(n)),
        "kinds": ("simulated",) * n,
        "modes": ("OFFBOARD",) * n,
        "armed": (True,) * n,
        "landed": (False,) * n,
        "connected": (True,) * n,
        "controls": ("program",) * n,
        "texts": ("",) * n,
        "p_n": p_n,
        "v_n": zero,
        "q_nb": level,
        "omega_b": zero,
        "has_true": np.ones(n, bool),
        "est_p_n": p_n,
        "est_v_n": zero,
        "est_q_nb": level,
        "est_omega_b": zero,
        "set_p_n": p_n,
        "set_v_n": zero,
        "set_yaw": np.zeros(n),
        "set_q_nb": level,
        "set_thrust": np.full(n, 0.5),
        "motors": np.full((n, MAX_ROTORS), 0.5),
        "battery": np.full(n, 90.0),
        "pose_age_s": np.full(n, 0.01),
        "silent_s": np.zeros(n),
    }
    return FleetSnapshot(**{**given, **changes})


def settings(n=2):
    rotors = tuple(Rotor(position_b=(x, y, -0.02), clockwise=cw) for x, y, cw in CORNERS)
    vehicles = tuple(
        VehicleSettings(
            name=f"uav{i + 1}",
            id=i + 1,
            kind="simulated",
            autopilot="builtin",
            index=i,
            body=f"uav{i + 1}",
            tools=None,
            start_n=(float(i), 0.0, 0.0),
            profile="iris",
            radius_m=0.275,
            height_m=0.1,
            rotors=rotors,
        )
        for i in range(n)
    )
    return Settings(
        size_m=(7.0, 4.0, 3.0),
        ceiling=True,
        fence=None,
        clock=None,
        truth=None,
        captures=(),
        vehicles=vehicles,
    )


def snapshot(n=2, **changes):
    given = Snapshot(
        run=Path("/runs/a"),
        name="lab",
        phase="running",
        time_s=12.0,
        real_time_factor=1.0,
        answers=True,
        settings=settings(n),
        fleet=fleet(n),
        processes=(),
        events=(),
    )
    return dataclasses.replace(given, **changes)
