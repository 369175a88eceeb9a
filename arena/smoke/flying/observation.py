"""Vehicle states for the referee, from the true states, the telemetry and the world's crash reports. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.smoke.language.model import Vector, VehicleState
from arena.wire.telemetry import Telemetry
from arena.wire.truth_page import Array, Truth

UP_M, DOWN_M = 0.10, 0.03
"""Heights of the lowest point of a vehicle above the floor [m]: airborne above UP_M, on the floor below DOWN_M.

Between the two heights the state does not change.
"""
MAX_AGE_S = 1.0
"""Age above which telemetry counts as unknown [s]."""
IDLE_ROTOR = 0.01
"""Rotor command (0..1) below which the vehicle is disarmed. The rotors of an armed vehicle idle above it."""


class VehicleStates:
    """States of all vehicles for the referee, from truth and telemetry. Remembers which vehicles are airborne.

    vehicles: rows of `vehicles` in the world's configuration (slice), in the order of the truth page (ground truth of the
        world in shared memory).
    """

    def __init__(self, vehicles: Sequence[Mapping[str, Any]]) -> None:
        self._names = [str(v["name"]) for v in vehicles]
        self._profiles = [v["profile"] for v in vehicles]
        self._airborne = dict.fromkeys(self._names, False)

    def update(
        self, truth: Truth | None, telemetry: Mapping[str, Telemetry], crashed: Mapping[str, str], now: float
    ) -> dict[str, VehicleState]:
        """Return vehicle name -> state at the time `now` [s], or {} while no true states are known.

        truth: ground truth of all vehicles, None if there is none yet.
        telemetry: vehicle -> telemetry, with times of reception in simulation time.
        crashed: vehicle -> crash report.
        now: simulation time [s].
        """
        if truth is None:
            return {}
        return {
            name: self._vehicle(name, i, truth, telemetry[name], crashed.get(name, ""), now)
            for i, name in enumerate(self._names)
        }

    def _vehicle(
        self, name: str, i: int, truth: Truth, telemetry: Telemetry, crashed: str, now: float
    ) -> VehicleState:
        p, v = _triple(truth.p_n[i]), _triple(truth.v_n[i])
        down = _cos_tilt(truth.q_nb[i])
        height = -p[2] - _reach_m(self._profiles[i], down)
        self._airborne[name] = height > (DOWN_M if self._airborne[name] else UP_M)
        return VehicleState(
            name=name,
            p_n=p,
            v_n=v,
            tilt_rad=math.acos(max(-1.0, min(1.0, down))),
            height_m=max(0.0, height),
            airborne=self._airborne[name],
            crashed=crashed,
            **_known_telemetry(telemetry, now, rotors=float(truth.motors[i].max())),
        )


def _known_telemetry(telemetry: Telemetry, now: float, *, rotors: float) -> dict[str, Any]:
    """Return the fields of VehicleState that come from telemetry. Values older than MAX_AGE_S are unknown.

    rotors: largest rotor command (0..1). A vehicle without recent heartbeat counts as disarmed if its rotors stand still.
    """

    def fresh(group: Any) -> Any:
        return group if group is not None and now - group.received_at <= MAX_AGE_S else None

    heart, ground, local = fresh(telemetry.heartbeat), fresh(telemetry.ground), fresh(telemetry.local)
    reference, status = fresh(telemetry.reference), fresh(telemetry.status)
    return {
        "mode": heart.mode if heart else "",
        "armed": heart.armed if heart else False if rotors < IDLE_ROTOR else None,
        "landed": ground.landed if ground else None,
        "est_p_n": _triple(local.pos) if local else None,
        "target_p_n": _triple(reference.pos) if reference and np.isfinite(reference.pos).all() else None,
        "battery": status.battery / 100.0 if status and math.isfinite(status.battery) else None,
    }


def _reach_m(profile: Mapping[str, Any], cos_tilt: float) -> float:
    """Return how far the lowest point of a tilted vehicle is below its body origin [m].

    Vehicles are cylinders, as in the world. profile: vehicle profile with the dimensions.
    """
    height = float(profile["height_m"])
    bottom = float(profile.get("ground_clearance_m", height / 2.0))
    rim = float(profile["radius_m"]) * math.sqrt(max(0.0, 1.0 - cos_tilt * cos_tilt))
    return max(bottom * cos_tilt, (bottom - height) * cos_tilt) + rim


def _cos_tilt(q_nb: Array) -> float:
    """Return the cosine of the angle between the body z axis and the vertical.

    q_nb: attitude (4,), w first.
    """
    _, x, y, _ = q_nb.tolist()
    return float(1.0 - 2.0 * (x * x + y * y))


def _triple(v: Array) -> Vector:
    a, b, c = v.tolist()
    return a, b, c
