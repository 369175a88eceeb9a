"""Truth, a vehicle's own words and the world's verdict -> what a referee sees of it. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.smoke.language.model import Vector, VehicleNow
from arena.wire.telemetry import Telemetry
from arena.wire.truth_page import Array, Truth

UP_M, DOWN_M = 0.10, 0.03
"""Of its lowest point above the floor: higher, it is airborne; lower, it is not; between, it is what it was."""
HEARD_S = 1.0
STILL = 0.01
"""Of a rotor, as a share of its full command: an armed one idles above it."""


class Eyes:
    """vehicles: rows of the world's slice, in the order of the truth page."""

    def __init__(self, vehicles: Sequence[Mapping[str, Any]]) -> None:
        self._names = [str(v["name"]) for v in vehicles]
        self._profiles = [v["profile"] for v in vehicles]
        self._airborne = dict.fromkeys(self._names, False)

    def see(
        self, truth: Truth | None, told: Mapping[str, Telemetry], crashed: Mapping[str, str], now: float
    ) -> dict[str, VehicleNow]:
        """told: what each vehicle said, heard by simulation time. crashed: vehicle -> how. now: simulation time [s]."""
        if truth is None:
            return {}
        return {
            name: self._vehicle(name, i, truth, told[name], crashed.get(name, ""), now)
            for i, name in enumerate(self._names)
        }

    def _vehicle(
        self, name: str, i: int, truth: Truth, told: Telemetry, crashed: str, now: float
    ) -> VehicleNow:
        p, v = _triple(truth.p_n[i]), _triple(truth.v_n[i])
        down = _cos_tilt(truth.q_nb[i])
        height = -p[2] - _reach_m(self._profiles[i], down)
        self._airborne[name] = height > (DOWN_M if self._airborne[name] else UP_M)
        return VehicleNow(
            name=name,
            p_n=p,
            v_n=v,
            tilt_rad=math.acos(max(-1.0, min(1.0, down))),
            height_m=max(0.0, height),
            airborne=self._airborne[name],
            crashed=crashed,
            **_words(told, now, rotors=float(truth.motors[i].max())),
        )


def _words(told: Telemetry, now: float, *, rotors: float) -> dict[str, Any]:
    """What it said in the last second. One that is not heard and whose rotors stand still is not armed: see `rotors`, 0..1."""

    def fresh(group: Any) -> Any:
        return group if group is not None and now - group.heard <= HEARD_S else None

    heart, ground, local = fresh(told.heart), fresh(told.ground), fresh(told.local)
    reference, status = fresh(told.reference), fresh(told.status)
    return {
        "mode": heart.mode if heart else "",
        "armed": heart.armed if heart else False if rotors < STILL else None,
        "landed": ground.landed if ground else None,
        "est_p_n": _triple(local.pos) if local else None,
        "target_p_n": _triple(reference.pos) if reference and np.isfinite(reference.pos).all() else None,
        "battery": status.battery / 100.0 if status and math.isfinite(status.battery) else None,
    }


def _reach_m(profile: Mapping[str, Any], cos_tilt: float) -> float:
    """Of the lowest point below the body's origin: bodies are cylinders, as the world has them."""
    height = float(profile["height_m"])
    bottom = float(profile.get("ground_clearance_m", height / 2.0))
    rim = float(profile["radius_m"]) * math.sqrt(max(0.0, 1.0 - cos_tilt * cos_tilt))
    return max(bottom * cos_tilt, (bottom - height) * cos_tilt) + rim


def _cos_tilt(q_nb: Array) -> float:
    """Of the body's z axis from the vertical."""
    _, x, y, _ = q_nb.tolist()
    return float(1.0 - 2.0 * (x * x + y * y))


def _triple(v: Array) -> Vector:
    a, b, c = v.tolist()
    return a, b, c
