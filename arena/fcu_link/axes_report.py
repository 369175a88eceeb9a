"""Texts for the user after a passed axes check: measured values, and a proposed EKF2_EV_DELAY. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from arena.motion_check.verdict import Verdict

DELAY_PARAM = "EKF2_EV_DELAY"
_LARGEST_MS = 300.0  # PX4 accepts no larger value


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Values for the report of an axes check (`arena preflight`), such as the latency of motion capture.

    latency_s, latency_error_s: from the exposure of a frame to its arrival at this computer, by the clock of the motion
        capture server [s]; not finite if it is unknown
    round_trip_s: fastest TIMESYNC round trip [s]; infinite if the autopilot does not answer
    delay_param: value of EKF2_EV_DELAY in the autopilot [ms]; None if it was not received
    date: day of the check
    """

    latency_s: float
    latency_error_s: float
    round_trip_s: float
    delay_param: float | None
    date: str


def proposed_delay_ms(verdict: Verdict, measured: Measured) -> tuple[float, float] | None:
    """Return the proposed EKF2_EV_DELAY and its uncertainty [ms]; None if the delay was not measured.

    A pose counts when the autopilot receives it: half a round trip after it was sent.
    """
    if verdict.delay_s is None or verdict.delay_error_s is None or not math.isfinite(measured.round_trip_s):
        return None
    half_s = measured.round_trip_s / 2.0
    return 1e3 * (verdict.delay_s + half_s), 1e3 * (verdict.delay_error_s + half_s)


def report_lines(vehicle: str, verdict: Verdict, limit_deg: float, measured: Measured) -> list[str]:
    """Return the lines that `arena preflight` prints when a vehicle has passed the axes check."""
    assert verdict.own is not None and verdict.axes is not None
    lines = [
        f"identity: body '{verdict.own.body}' moved with the vehicle (correlation {verdict.own.correlation:.3f}{_next_best(verdict)})",
        f"axes: {verdict.axes.turned_deg:.1f} deg off (limit {limit_deg:g} deg); lifted by {verdict.rise_m:.2f} m",
    ]
    if math.isfinite(measured.latency_s):
        lines.append(
            f"latency: frames arrive {1e3 * measured.latency_s:.0f} ms after their exposure, +-{1e3 * measured.latency_error_s:.0f} ms "
            "(clock of the motion capture server)"
        )
    else:
        lines.append("latency: unknown, because the motion capture server answers no clock requests")
    return lines + _delay_lines(vehicle, verdict, measured)


def _next_best(verdict: Verdict) -> str:
    if not verdict.others:
        return ", no other body in the room"
    best = max(verdict.others.values(), key=lambda match: match.correlation)
    return f"; next best '{best.body}' {best.correlation:.3f}"


def _delay_lines(vehicle: str, verdict: Verdict, measured: Measured) -> list[str]:
    proposed = proposed_delay_ms(verdict, measured)
    if proposed is None:
        why = (
            "its motion was not clear enough"
            if verdict.delay_s is None
            else "the autopilot answers no TIMESYNC"
        )
        return [f"delay: not measured, because {why}"]
    value, error = proposed
    now = "unknown" if measured.delay_param is None else f"{measured.delay_param:g}"
    line = f"delay: poses reach the autopilot {value:.0f} ms after the motion, +-{error:.0f} ms; {DELAY_PARAM} is {now}"
    if measured.delay_param is not None and abs(value - measured.delay_param) <= error:
        return [f"{line}, which agrees"]
    if not 0.0 <= value <= _LARGEST_MS:
        return (
            [f"{line}. PX4 accepts 0 to {_LARGEST_MS:g} ms"]
            if value + error < 0.0 or value > _LARGEST_MS
            else [line]
        )
    how = f"arena preflight: gyroscope against captured motion, +-{error:.0f} ms"
    return [
        f"{line}. To change it, write this under {vehicle} in the YAML, run `arena params push {vehicle}`, and restart the autopilot:",
        f'  measured: {{{DELAY_PARAM}: {{value: {value:.0f}, date: {measured.date}, how: "{how}"}}}}',
    ]
