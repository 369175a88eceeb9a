"""Verdict of the motion check of `arena preflight`: identity, axes and delay of a captured body. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from arena.geometry import Array
from arena.motion_check.axes import Axes, fit_axes, turn_words
from arena.motion_check.body_match import BodyMatch, match_body, similar_bodies
from arena.motion_check.guided_motion import FAST_RAD_S, GuidedMotion, Step
from arena.motion_check.recording import Recording, captured_down
from arena.motion_check.rotation import LARGEST_DELAY_S, captured_rates, compare, mean_rates

RISE_M = 0.15
DELAY_ERROR_S = 0.005
"""Error of a delay with little sensor noise, as tests measure it [s]. The spread between both tilts is added."""
_STILL_SHARE = 0.2
_AGREES = 0.9
_SPAN_S = 0.1
_REDEFINE = "Put the vehicle level with its nose along the x axis of the cameras, define the rigid body again, then repeat the check"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict of an identity and axes check of a captured body.

    problems: what is wrong, each with what to do; empty if the check has passed.

    own: agreement of the vehicle's own body with the gyroscope; None without enough data
    others: other body -> its agreement
    axes: rotation between captured and measured axes; None if it was not determined
    rise_m: by how much the captured body was lifted [m]
    delay_s, delay_error_s: time by which the poses that are sent to the autopilot are later than the motion, and its
        error [s]; None if it was not measured
    """

    problems: tuple[str, ...]
    own: BodyMatch | None = None
    others: Mapping[str, BodyMatch] = field(default_factory=dict)
    axes: Axes | None = None
    rise_m: float = 0.0
    delay_s: float | None = None
    delay_error_s: float | None = None

    @property
    def passed(self) -> bool:
        """True if no problem was found."""
        return not self.problems


def judge(
    body: str, motion: GuidedMotion, recorded: Recording, offset_s: float | None, limit_deg: float
) -> Verdict:
    """Return the verdict about the captured body's identity, axes and delay after a complete motion.

    body: name of the vehicle's own rigid body
    offset_s: this computer's clock minus the autopilot's clock [s]; None if it is unknown
    limit_deg: largest rotation between captured and measured axes [deg]
    """
    begin, end = motion.since[Step.LIFT], motion.since[Step.DONE]
    imu_t = recorded.imu_times(offset_s)
    span_s = max(_SPAN_S, 4.0 * float(np.median(np.diff(imu_t))))
    gyro = _within(mean_rates(imu_t, recorded.gyro_b, span_s), begin, end)
    captured = captured_rates(recorded.pose_at, recorded.q_nb, span_s)
    own = match_body(body, captured, gyro)
    others = {
        name: match_body(name, captured_rates(times, attitudes, span_s), gyro)
        for name, (times, attitudes) in recorded.others.items()
        if name != body and len(times) > 1
    }
    rise_m = recorded.rise_m(begin)
    wrong_body = _body_problem(own, others)
    if wrong_body:
        return Verdict(problems=(wrong_body,), own=own, others=others, rise_m=rise_m)
    found = compare(captured, gyro)
    delay_s = found.delay_s if found is not None else 0.0
    axes = _axes(captured, gyro, recorded, (imu_t, span_s), delay_s)
    problems = [*_axes_problems(axes, limit_deg), *_rise_problems(rise_m)]
    measured = _delay(captured, gyro, motion) if not problems else None
    return Verdict(
        problems=tuple(problems),
        own=own,
        others=others,
        axes=axes,
        rise_m=rise_m,
        delay_s=measured[0] if measured else None,
        delay_error_s=measured[1] if measured else None,
    )


def _body_problem(own: BodyMatch, others: Mapping[str, BodyMatch]) -> str:
    """Return why the captured body may belong to another vehicle; "" if the body is certainly the right one."""
    similar = similar_bodies(own, others)
    if not own.moves_with_vehicle:
        what = (
            f"the captured body '{own.body}' did not move with the vehicle"
            if own.ratio < _STILL_SHARE
            else f"the captured body '{own.body}' moved differently from the vehicle"
        )
        if similar:
            best = max(similar, key=lambda name: others[name].correlation)
            return (
                f"{what}, but the body '{best}' moved with it: they are exchanged. Correct `mocap_body`, the names in the "
                "cameras' software, or the markers"
            )
        return (
            f"{what} (correlation {own.correlation:.2f}, rotation {own.ratio:.2f} of the gyroscope's). Is another body "
            f"named '{own.body}'? Do its markers move with the vehicle?"
        )
    if similar:
        names = ", ".join(f"'{name}'" for name in similar)
        return (
            f"the body {names} moved in the same way at the same time, so the vehicle's body is not certain. Move only this "
            "vehicle, and repeat the check"
        )
    return ""


def _axes(
    captured: tuple[Array, Array],
    gyro: tuple[Array, Array],
    recorded: Recording,
    sampled: tuple[Array, float],
    delay_s: float,
) -> Axes | None:
    (times, rates), (imu_t, span_s) = gyro, sampled
    moved = np.stack([np.interp(times + delay_s, captured[0], captured[1][:, k]) for k in range(3)], axis=-1)
    # The integral of the specific force over the smoothing time is that of gravity, except for the hand's acceleration.
    force_t, force = mean_rates(imu_t, recorded.accel_b, span_s)
    force = np.stack([np.interp(times, force_t, force[:, k]) for k in range(3)], axis=-1)
    down = -force / np.maximum(np.linalg.norm(force, axis=1), 1e-6)[:, None]
    seen = captured_down(times + delay_s, recorded.pose_at, recorded.q_nb)
    return fit_axes((moved, rates), (seen, down))


def _axes_problems(axes: Axes | None, limit_deg: float) -> list[str]:
    if axes is None:
        return [
            "the vehicle turned about one axis only: tilt it nose down, then right side down, and repeat the check"
        ]
    if axes.mirrored:
        return [
            "the captured axes are mirrored (left-handed): check the up axis and the axis convention of the cameras' stream"
        ]
    if axes.turned_deg > limit_deg:
        return [f"the captured body is {turn_words(axes)} (limit {limit_deg:g} deg). {_REDEFINE}"]
    if axes.agreement < _AGREES:
        return [
            f"captured and measured motion agree only to {axes.agreement:.2f}, expected {_AGREES:g}: do the markers sit "
            "firmly? Repeat the check"
        ]
    return []


def _rise_problems(rise_m: float) -> list[str]:
    if rise_m >= RISE_M:
        return []
    return [
        f"the captured body rose by {rise_m:.2f} m, expected {RISE_M:g} m or more: lift the vehicle higher. If you did, the "
        "z axis of the cameras points down"
    ]


def _delay(
    captured: tuple[Array, Array], gyro: tuple[Array, Array], motion: GuidedMotion
) -> tuple[float, float] | None:
    """Return the delay of the captured motion and the error of this delay [s]; None if unknown.

    The delay is relative to the gyroscope. It is measured over the whole motion, and again over each tilt
    (nose down, right side down). The largest difference between these values is a part of the error.
    """
    middle, end = motion.since[Step.RIGHT_DOWN], motion.since[Step.DONE]
    parts = [compare(captured, _within(gyro, *span)) for span in ((0.0, end), (0.0, middle), (middle, end))]
    delays = [p.delay_s for p in parts if p is not None and p.gyro_rad_s > 0.1 * FAST_RAD_S]
    if parts[0] is None or len(delays) < 2 or abs(parts[0].delay_s) >= LARGEST_DELAY_S - 0.02:
        return None
    return parts[0].delay_s, DELAY_ERROR_S + max(abs(d - parts[0].delay_s) for d in delays)


def _within(series: tuple[Array, Array], begin: float, end: float) -> tuple[Array, Array]:
    inner = (series[0] >= begin) & (series[0] <= end)
    return series[0][inner], series[1][inner]
