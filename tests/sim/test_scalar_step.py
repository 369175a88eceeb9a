"""The scalar step of small fleets gives the same flight as the batched one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arena.sim import world as module
from arena.sim.world import World

from .sim_slices import PROFILE, slice_of, vehicle

CURVE = {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": 40.0}
INERTIA = {"moment_kg_m2": 2.74e-5, "thrust_n_s2": 8.54858e-6}
PACK = {**PROFILE["battery"], "thrust_at_v": 12.0}


def flown(most: int, height_m: float, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Fly two tilted vehicles, one above the other, in wind and gusts; return their true states, one row per step."""
    monkeypatch.setattr(module, "MAX_SCALAR_VEHICLES", most)
    fleet = [
        vehicle(
            f"uav{k}",
            k,
            position=[2.0 * k, 0.2, -height_m],
            rpy=[0.1, -0.2, 0.7 * k],
            drag_kg_s=[0.2, 0.3, 0.4],
            thrust_curve=CURVE,
            body_drag_kg_m=[0.01, 0.02, 0.03],
            ground_effect={"rotor_radius_m": 0.127, "body_lift": 2.0},
            battery=PACK,
        )
        for k in (1, 2)
    ]
    fleet[1]["position"] = [1.9, 0.2, -height_m - 0.6]
    for each in fleet:
        each["profile"] |= {"downwash": {"rotor_radius_m": 0.127}, "rotor_inertia": INERTIA}
    settings = slice_of(*fleet, wind_m_s=[0.5, -0.2, 0.1], gusts_m_s=6.0, size_m=[12.0, 8.0, 8.0])
    world, rng, seen = World(settings), np.random.default_rng(1), []
    assert (world._scalar is None) == (most == 0)
    for _ in range(200):
        world.step(world.hover[:, None] + 0.02 * rng.standard_normal((2, 4)))
        t = world.truth()
        seen.append(np.hstack([t.p_n, t.q_nb, t.v_n, t.omega_b, t.accel_b, t.motors]))
    world.close()
    return np.array(seen)


@pytest.mark.parametrize(("height_m", "within"), [(3.0, 1e-9), (0.0, 1e-6)])
def test_scalar_and_batched_steps_agree(
    height_m: float, within: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    few, batched = flown(2, height_m, monkeypatch), flown(0, height_m, monkeypatch)
    assert np.abs(batched[-1] - batched[0]).max() > 0.1
    assert np.abs(few - batched).max() < within
