"""Separation of vehicles: predicts when two vehicles come too close, and which of them must hold.

Pure.

The prediction is that a vehicle keeps its velocity, or flies to its fixed target, but does not stop earlier
than it can. A vehicle under the order to hold is predicted to stop. If two vehicles come closer than `at_m`,
the vehicle that comes later in the YAML is held at once. The other vehicle continues for as long as this
avoids the approach. It is held when a hold 0.1 s later would be too late for its own stop.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.copilot.fleet_state import FleetState, Mask, Violation, length
from arena.copilot.settings import Step

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_SAMPLE_S = 0.1
_WAIT_S = 0.12
_PARTING_M_S = 0.1
_ON_THE_WAY_M = 0.3


@dataclass(frozen=True, kw_only=True)
class SeparationResult:
    """Result of the separation rule: violations, conflicting targets, and the smallest distance.

    broken: violations, one per vehicle to hold.
    meeting: (first, yielding) rows of the pairs that are commanded to the same place.
    closest: smallest distance of all pairs [m].
    """

    broken: tuple[Violation, ...]
    meeting: tuple[tuple[int, int], ...]
    closest: float


def separation(m: FleetState, at_m: float, ahead_s: float, names: list[str]) -> SeparationResult:
    """Check the present and predicted distances of all pairs of vehicles, and return which vehicles must hold.

    at_m: minimum distance of the origins [m]. ahead_s: shortest prediction time [s].
    """
    a, b = _pairs(len(m.placed))
    counts = m.placed[a] & m.placed[b] & (m.flying[a] | m.flying[b])
    a, b = a[counts], b[counts]
    if not len(a):
        return SeparationResult(broken=(), meeting=(), closest=float("inf"))
    gap = length(m.p_n[b] - m.p_n[a])
    speed = length(np.maximum(np.abs(m.v_n), np.abs(m.stop.v_n)))
    horizon_s = _horizon(m, ahead_s)
    near = gap - (speed[a] + speed[b]) * horizon_s < at_m
    return SeparationResult(
        broken=_broken(m, a[near], b[near], gap[near], at_m, ahead_s, horizon_s, names),
        meeting=_meeting(m, a, b, at_m),
        closest=float(gap.min()),
    )


@functools.cache
def _pairs(count: int) -> tuple[Index, Index]:
    """Return all pairs of `count` vehicles as two arrays of rows: the first and the second vehicle of each pair (P,)."""
    first, second = np.triu_indices(count, 1)
    first.flags.writeable = second.flags.writeable = False
    return first, second


def _horizon(m: FleetState, ahead_s: float) -> float:
    """Return the time for which the paths of vehicles are predicted [s]: `ahead_s`, or longer if a vehicle needs longer to stop."""
    longest = float((m.stop.react_s + 1.2 * m.stop.took_s.max(1)).max()) if len(m.stop.react_s) else 0.0
    return max(ahead_s, min(longest + _WAIT_S, 10.0))


def _broken(
    m: FleetState,
    a: Index,
    b: Index,
    gap: Array,
    at_m: float,
    ahead_s: float,
    horizon_s: float,
    names: list[str],
) -> tuple[Violation, ...]:
    if not len(a):
        return ()
    times = np.arange(0.0, horizon_s + _SAMPLE_S, _SAMPLE_S)
    still = np.where(m.flying[:, None, None], 1.0, 0.0)
    here = m.p_n[:, None, :]
    stopping = here + still * (m.stop.path(times) - here)
    going = np.where(m.held[:, None, None], stopping, _predicted_paths(m, times, ahead_s, stopping))
    nearest, when = approach(going[a], going[b], times)
    closing = ((m.p_n[b] - m.p_n[a]) * (m.v_n[b] - m.v_n[a])).sum(1) < _PARTING_M_S * gap
    conflicts = ((nearest < at_m) & closing).nonzero()[0]
    if not len(conflicts):
        return ()
    late = here + still * (m.stop.path(times, _WAIT_S) - here)
    found: list[Violation] = []
    for k in conflicts:
        first, yields = _order(m, int(a[k]), int(b[k]))
        if not m.open[yields]:
            continue  # neither may be commanded
        text = _distance_text(float(gap[k]), float(nearest[k]), float(when[k]), at_m)
        enough: Step = (
            "land" if gap[k] < at_m else "hold"
        )  # two vehicles that land side by side must not be terminated
        found.append(
            Violation(row=yields, rule="separation", why=f"yields to {names[first]}: {text}", enough=enough)
        )
        if m.open[first]:
            reach, _ = approach(late[[first]], stopping[[yields]], times)
            if reach[0] < at_m:
                why = f"{names[yields]} cannot yield far enough: {text}"
                found.append(Violation(row=first, rule="separation", why=why, enough=enough))
    return tuple(found)


def _order(m: FleetState, a: int, b: int) -> tuple[int, int]:
    """Return the rows of two close vehicles as (vehicle with right of way, vehicle that must hold).

    The vehicle that comes later in the YAML must hold. If the copilot may command only the earlier vehicle, the earlier
    vehicle must hold.
    """
    return (a, b) if m.open[b] or not m.open[a] else (b, a)


def _distance_text(gap: float, nearest: float, when: float, at_m: float) -> str:
    if gap < at_m:
        return f"they are {gap:.2f} m apart (at least {at_m:g} m)"
    return f"{gap:.1f} m apart, they would be {nearest:.2f} m apart in {when:.1f} s (at least {at_m:g} m)"


def _predicted_paths(m: FleetState, times: Array, ahead_s: float, stopping: Array) -> Array:
    """Return the predicted positions [m] [NED] (N, K, 3) of N vehicles at K times.

    Each vehicle keeps its velocity. A vehicle that flies to a constant target position stops there.

    A vehicle flies at least as far as it needs to stop.
    times: time since now [s] (K,)
    ahead_s: longest time for which a vehicle keeps its velocity [s]
    stopping: positions at the same times if the vehicles are commanded to hold now [m] [NED] (N, K, 3)
    """
    v = np.where((m.flying & m.moving)[:, None], m.v_n, 0.0)
    speed2 = (v * v).sum(1)
    to = np.where(m.settled[:, None], m.target - m.p_n, np.nan)
    arrive = np.where(speed2 > 1e-6, (to * v).sum(1) / np.maximum(speed2, 1e-6), np.nan)
    beside = length(to - v * arrive[:, None])
    ends = (
        m.settled & (beside < _ON_THE_WAY_M) & (arrive >= 0.0)
    )  # NaN compares false: the vehicle then keeps its velocity
    until = np.where(ends, arrive, ahead_s)
    going = (
        m.p_n[:, None, :]
        + v[:, None, :] * np.minimum(times[None, :], np.minimum(until, ahead_s)[:, None])[:, :, None]
    )
    here = m.p_n[:, None, :]
    farther = ((stopping - here) ** 2).sum(2) > ((going - here) ** 2).sum(2)
    return np.where(farther[:, :, None], stopping, going)


def approach(one: Array, other: Array, times: Array) -> tuple[Array, Array]:
    """Return the closest approach of P pairs of paths: distance [m] (P,) and time [s] (P,).

    one, other: positions [m] (P, K, 3) at `times` [s] (K,), linear between the samples.
    """
    r = other - one
    d = r[:, 1:] - r[:, :-1]
    length2 = np.maximum((d * d).sum(2), 1e-12)
    s = np.minimum(np.maximum(-(r[:, :-1] * d).sum(2) / length2, 0.0), 1.0)
    away = length(r[:, :-1] + s[:, :, None] * d)
    k = away.argmin(1)
    pick = np.arange(len(k))
    return away[pick, k], times[k] + s[pick, k] * _SAMPLE_S


def _meeting(m: FleetState, a: Index, b: Index, at_m: float) -> tuple[tuple[int, int], ...]:
    aimed: Mask = m.settled & m.offboard & m.flying
    both = aimed[a] & aimed[b]
    if not both.any():
        return ()
    close = both & (length(m.target[b] - m.target[a]) < at_m)
    return tuple((int(x), int(y)) for x, y in zip(a[close], b[close], strict=True))
