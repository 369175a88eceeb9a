"""Synthetic flights for the tests of the referee: observations made by functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from arena.smoke.language.model import Observation, VehicleState
from arena.smoke.referee.referee import Referee
from arena.smoke.referee.verdict import Verdict

START_S = 5.0  # of the first observation: a simulation has run for some time when its arena is up
UP_S, DOWN_S = 1.0, 10.0  # take-off and touchdown of uav1 after the first observation, as `flight` has them
STEP_S = 0.02

Script = Callable[[float], Mapping[str, Any]]


def uav(name: str = "uav1", height: float = 0.0, **more: Any) -> VehicleState:
    """Return a vehicle that stands or hovers, at the north coordinate of its number [m]."""
    place = (float(name[3:]), 0.0, -height)
    values = {"mode": "OFFBOARD" if height else "AUTO.LOITER", "armed": height > 0.0, "battery": 0.8, **more}
    base = VehicleState(
        name=name, p_n=place, v_n=(0.0, 0.0, 0.0), tilt_rad=0.0, height_m=height, airborne=height > 0.0
    )
    return replace(base, **values)


def flight(t: float, **more: Any) -> Mapping[str, Any]:
    """Return uav1 in flight at 1 m from UP_S to DOWN_S, in LAND at the end, and uav2 on the floor.

    t: time since the first observation [s].
    """
    aloft = UP_S <= t < DOWN_S - 1e-9
    values = {"mode": "AUTO.LAND", "v_n": (0.0, 0.0, 0.5)} if aloft and t > 5.0 else {}
    return {"uav1": uav("uav1", 1.0 if aloft else 0.0, **{**values, **more}), "uav2": uav("uav2")}


def fly(
    referee: Referee,
    script: Script = flight,
    until: float = 40.0,
    events: Mapping[float, str] | None = None,
    processes: Script = lambda t: {},
) -> list[tuple[float, str, bool]]:
    """Observe until the flight is over. Return (time since the first observation [s], action, undo) of each action."""
    done = []
    for k in range(round(until / STEP_S)):
        t = k * STEP_S
        logged = tuple(text for at, text in (events or {}).items() if abs(at - t) < STEP_S / 2)
        actions = referee.observe(
            Observation(time_s=START_S + t, vehicles=script(t), processes=processes(t), events=logged)
        )
        done += [(round(t, 2), action.place.text, action.undo) for action in actions]
        if referee.over:
            break
    return done


def judged(
    referee: Referee, script: Script = flight, outcome: Mapping[str, Any] | None = None, **more: Any
) -> Verdict:
    """Fly, finish and return the verdict."""
    fly(referee, script, **more)
    referee.finish(outcome or {})
    return referee.verdict()


def sentence(verdict: Verdict) -> str:
    """Return the sentence of the only failure."""
    ((_, failure),) = verdict.failures
    return failure


def both(t: float, **more: Any) -> Mapping[str, Any]:
    """Return both vehicles in flight from 1 s to 6 s; at 3 s they are 0.6 m apart."""
    aloft = 1.0 <= t < 6.0
    height = 1.0 if aloft else 0.0
    near = 1.6 if abs(t - 3.0) < 1e-6 else 3.0
    return {
        "uav1": uav("uav1", height, **more),
        "uav2": uav("uav2", height, **{"p_n": (near, 0.0, -height), **more}),
    }


FLOWN = "  - at: uav1.airborne\n"
BROKEN = {
    "separation > 0.8 m": (
        {},
        "separation between uav1 and uav2 was 0.60 m at 8.00 s; expected more than 0.80 m",
    ),
    "uav1.tilt < 40 deg": (
        {"tilt_rad": math.radians(45)},
        "uav1.tilt was 45.00 deg at 6.00 s; expected less than 40.00 deg",
    ),
    "each.speed < 1 m/s": (
        {"v_n": (0.0, 1.5, 0.0)},
        "uav1.speed was 1.50 m/s at 6.00 s; expected less than 1.00 m/s",
    ),
    "uav2.battery > 90 %": ({}, "uav2.battery was 80.00 % at 6.00 s; expected more than 90.00 %"),
    "not uav1.height > 0.9 m": ({}, "uav1.height was 1.00 m at 6.00 s; expected less than 0.90 m"),
    "inside geofence": ({"p_n": (5.5, 0.0, -1.0)}, "uav1 was 0.50 m outside the geofence at 6.00 s"),
    "uav1.estimate error < 0.1 m": ({"est_p_n": (1.0, 0.2, -1.0)}, "uav1.estimate error was "),
    "tracking(uav1) < 0.1 m": ({"target_p_n": (1.0, 0.2, -1.0)}, "tracking(uav1) was 0.20 m at 6.00 s"),
    "tracking(uav1) < 0.1 m rms": (
        {"target_p_n": (1.0, 0.2, -1.0)},
        "tracking(uav1) was 0.20 m rms over its flight in OFFBOARD; expected less",
    ),
    "uav1.mode == OFFBOARD": ({}, "uav1.mode was AUTO.LOITER at 11.00 s; expected uav1.mode == OFFBOARD"),
    "not each.crashed": ({"crashed": "hit the wall"}, "uav1 was crashed (hit the wall) at 6.00 s"),
    'not event "critical"': (
        {},
        '"critical" was logged: Critical battery at 9.00 s; expected not event "critical"',
    ),
    "router is READY": ({}, "router was BACKOFF at 7.00 s; expected router is READY"),
    "uav1.touchdown < 0.1 m/s": (
        {"v_n": (0.0, 0.0, 0.4)},
        "uav1.touchdown was 0.40 m/s at 11.00 s; expected less than 0.10 m/s",
    ),
}


def flown_with_faults(referee: Referee, more: Mapping[str, Any]) -> Verdict:
    def processes(t: float) -> Mapping[str, str]:
        return {"router": "BACKOFF" if 2.0 <= t < 2.5 else "READY"}

    return judged(referee, lambda t: both(t, **more), events={4.0: "Critical battery"}, processes=processes)
