"""Motion of one vehicle for a film: poses at given times, computed from the rows of its log. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arena.flight_log.columns import RPY, WXYZ
from arena.flight_log.flight import COLUMNS_OF, Flight
from arena.geometry import Array, quat_from_euler
from arena.render.airframe import Airframe, default_airframe

MAX_GAP_S = 1.0
"""Longest gap in the log over which a pose is interpolated [s]. In longer gaps the vehicle is drawn as outdated."""
_TINY = 1e-6


@dataclass(frozen=True, kw_only=True)
class Track:
    """Motion of one vehicle, from the n rows of its log that contain a position.

    t: time since the start of the film's clock [s] (n,).  p_n: position [m] [NED] (n, 3).
    q_nb: attitude wxyz (n, 4).  ref_n: position reference [m] [NED] (n, 3), NaN if there is none.
    mode: flight modes (n,).  armed: flags (n,).  armed_known: false where the log does not contain the arming state (n,).
    """

    name: str
    t: Array
    p_n: Array
    q_nb: Array
    ref_n: Array
    mode: Sequence[str]
    armed: NDArray[np.bool_]
    armed_known: NDArray[np.bool_]
    airframe: Airframe


@dataclass(frozen=True, kw_only=True)
class Moments:
    """State of one vehicle at the times of the f pictures of a film.

    p_n: position [m] [NED] (f, 3).  q_nb: attitude wxyz (f, 4).  ref_n: position reference [m] [NED] (f, 3), NaN if none.
    mode: flight modes (f,).  armed: flags (f,).  armed_known: false where the log does not contain the arming state (f,).
    known: false where the log has a gap of more than MAX_GAP_S (f,).
    """

    p_n: Array
    q_nb: Array
    ref_n: Array
    mode: Sequence[str]
    armed: NDArray[np.bool_]
    armed_known: NDArray[np.bool_]
    known: NDArray[np.bool_]


def track(flight: Flight, start_s: float, airframe: Airframe | None = None) -> Track | None:
    """Return the motion in a log, or None if the log contains no position.

    start_s: time of the film's clock zero, on the clock of the log [s].  airframe: None for a default quadrotor.
    """
    p_n, q_nb = flight.pos, _attitude(flight)
    known = np.isfinite(p_n).all(axis=1)
    if not known.any():
        return None
    rows = np.flatnonzero(known)
    return Track(
        name=flight.name,
        t=flight.t[rows] + (flight.t0 - start_s),
        p_n=p_n[rows],
        q_nb=q_nb[rows],
        ref_n=np.where(flight.armed[:, None], flight.group("pos_ref"), np.nan)[rows],
        mode=[flight.mode[int(i)] for i in rows],
        armed=flight.armed[rows],
        armed_known=flight.armed_known[rows],
        airframe=airframe or default_airframe(),
    )


def _attitude(flight: Flight) -> Array:
    """Return the attitude quaternions wxyz (n, 4) of a log.

    The attitude comes from the source of the position if it has one. Unknown rows repeat the last known row.
    """
    for source in (COLUMNS_OF[flight.position_source], "ekf"):
        q = flight.group(f"{source}.att_q", WXYZ)
        rpy = flight.group(f"{source}.att_euler", RPY)
        q = np.where(np.isfinite(q).all(axis=1, keepdims=True), q, quat_from_euler(rpy))
        if np.isfinite(q).all(axis=1).any():
            break
    else:
        return np.tile([1.0, 0.0, 0.0, 0.0], (flight.t.size, 1))
    good = np.flatnonzero(np.isfinite(q).all(axis=1))
    last = good[np.maximum(np.searchsorted(good, np.arange(len(q)), side="right") - 1, 0)]
    q = q[last]
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def at(track: Track, times: Array) -> Moments:
    """Return the state of a vehicle at the times of the pictures.

    Poses are interpolated linearly. Other values keep their last value.

    times: time on the film's clock [s] (f,). Before the first row of the log and after the last row, the vehicle stands still.
    """
    after = np.clip(np.searchsorted(track.t, times), 1, max(len(track.t) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(track.t) - 1)
    gap = track.t[after] - track.t[before]
    share = np.clip((times - track.t[before]) / np.maximum(gap, _TINY), 0.0, 1.0)
    q0, q1 = track.q_nb[before], track.q_nb[after]
    q1 = np.where((q0 * q1).sum(axis=1, keepdims=True) < 0.0, -q1, q1)
    q = q0 + share[:, None] * (q1 - q0)  # rows are some 30 ms apart, so a line is close to the circle
    held = np.clip(np.searchsorted(track.t, times, side="right") - 1, 0, len(track.t) - 1)
    return Moments(
        p_n=track.p_n[before] + share[:, None] * (track.p_n[after] - track.p_n[before]),
        q_nb=q / np.linalg.norm(q, axis=1, keepdims=True),
        ref_n=track.ref_n[held],
        mode=[track.mode[int(i)] for i in held],
        armed=track.armed[held],
        armed_known=track.armed_known[held],
        known=(gap <= MAX_GAP_S) | (share <= 0.0) | (share >= 1.0),
    )


def flown_span(
    tracks: Sequence[Track], *, before_s: float = 1.0, after_s: float = 1.5
) -> tuple[float, float]:
    """Return start and end of the film [s]: shortly before the first arming to shortly after the last disarming.

    If no vehicle was armed, this is the whole log.
    """
    armed = [t.t[t.armed] for t in tracks if t.armed.any()]
    first, last = min(t.t[0] for t in tracks), max(t.t[-1] for t in tracks)
    if not armed:
        return float(first), float(last)
    return (
        float(max(first, min(a[0] for a in armed) - before_s)),
        float(min(last, max(a[-1] for a in armed) + after_s)),
    )
