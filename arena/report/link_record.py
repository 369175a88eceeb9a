"""Messages and poses of one vehicle over time, from the record of the flight: rates, gaps, delays, texts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from arena.geometry import Array

SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
"""MAV_SEVERITY 0 to 7 of STATUSTEXT."""


@dataclass(frozen=True, kw_only=True)
class StatusText:
    """STATUSTEXT message of an autopilot.

    at_s: time of reception [s].
    severity: MAV_SEVERITY, 0 (emergency) to 7 (debug).
    """

    at_s: float
    severity: int
    text: str


def _none() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class LinkRecord:
    """Messages and poses that were recorded for one vehicle. Times are on the report's time axis [s].

    down_s, up_s: times of the datagrams from and to the vehicle (n,).
    pose_s: times at which poses of the vehicle's rigid body were received (n,), tracked poses only.
    pose_age_s: time from the exposure to the reception of each of these poses [s] (n,). Between computers with different
        clocks the smallest delay counts as 0.
    vision_s: times at which the autopilot has received poses, from its own log (n,); empty if it has left none.
    texts: the autopilot's STATUSTEXTs.
    """

    down_s: Array = field(default_factory=_none)
    up_s: Array = field(default_factory=_none)
    pose_s: Array = field(default_factory=_none)
    pose_age_s: Array = field(default_factory=_none)
    vision_s: Array = field(default_factory=_none)
    texts: tuple[StatusText, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Longest time without a message, and when it began.

    at_s: its begin [s].
    length_s: its length [s].
    """

    at_s: float
    length_s: float


def rate_over_time(stamps: Array, end_s: float, width_s: float = 1.0) -> tuple[Array, Array]:
    """Return the message rate over time: the centres of time bins [s] (m,) and the rate in each bin [Hz] (m,).

    stamps: times of the messages [s] (n,), in any order.  end_s: end of the record, so that a stream that has ended has the
    rate 0.  width_s: width of a bin [s].
    """
    if not stamps.size or (end_s := max(end_s, float(stamps.max()))) - stamps.min() < width_s:
        return np.zeros(0), np.zeros(0)
    bins = int((end_s - stamps.min()) / width_s)
    edges = stamps.min() + width_s * np.arange(bins + 1)
    counts, _ = np.histogram(stamps, edges)
    return edges[:-1] + width_s / 2.0, counts / width_s


def mean_rate(stamps: Array) -> float | None:
    """Return the mean rate of messages from their times [Hz], or None for fewer than two messages.

    stamps: times [s] (n,).
    """
    duration = float(np.ptp(stamps)) if stamps.size > 1 else 0.0
    return (stamps.size - 1) / duration if duration > 0.0 else None


def longest_gap(stamps: Array, start_s: float = -np.inf, end_s: float = np.inf) -> Gap | None:
    """Return the longest time without a message, or None if there are too few messages to measure one.

    stamps: times of the messages [s] (n,), increasing.  start_s, end_s: only gaps that begin in this time count.
    """
    counted = stamps[(stamps >= start_s) & (stamps <= end_s)]
    if np.isfinite(end_s) and counted.size:
        counted = np.append(counted, end_s)
    if counted.size < 2:
        return None
    gaps = np.diff(counted)
    k = int(gaps.argmax())
    return Gap(at_s=float(counted[k]), length_s=float(gaps[k]))
