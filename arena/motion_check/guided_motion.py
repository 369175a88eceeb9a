"""Motion of a vehicle in the hands of a person, step by step, as its inertial sensors measure it. Pure.

A person lifts the vehicle, tilts it nose down, levels it, tilts it right side down, and puts it down. The steps follow
the inertial sensors only, so that a wrong captured body cannot end the motion too early.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from arena.constants import GRAVITY_M_S2
from arena.motion_check.recording import measured_down

TILT_DEG, LEVEL_DEG = 25.0, 12.0
FAST_RAD_S = 0.5
STEP_TIMEOUT_S = 60.0
GAP_S = 0.5
"""Longest time without a pose or a sample of the inertial sensors while the vehicle is moved [s]."""
_REST_S, _REST_RAD_S = 1.0, 0.15
_SMOOTHING_S = 0.3
_WRONG_S = 1.0  # a tilt in another direction for so long is not on the way to the right one
_LIFT_S, _LIFT_RAD_S, _LIFT_M_S2 = 0.3, 0.15, 0.6  # time of motion, and what counts as motion
_MIN_SAMPLES = 6


class Step(StrEnum):
    """Steps of the guided motion, in their order."""

    REST = "rest"
    LIFT = "lift"
    NOSE_DOWN = "nose down"
    LEVEL = "level"
    RIGHT_DOWN = "right side down"
    PUT_DOWN = "put down"
    DONE = "done"


ORDER = tuple(Step)
TEXTS = {
    Step.REST: "Put the vehicle down, level, and take your hands off",
    Step.LIFT: "Lift the vehicle by half a metre",
    Step.NOSE_DOWN: f"Tilt it nose down by {TILT_DEG:g} deg or more, within one second",
    Step.LEVEL: "Hold it level",
    Step.RIGHT_DOWN: f"Tilt it right side down by {TILT_DEG:g} deg or more, within one second",
    Step.PUT_DOWN: "Level it, put it down, and take your hands off",
    Step.DONE: "The motion is complete",
}
_TILTS = (Step.NOSE_DOWN, Step.RIGHT_DOWN)


@dataclass(frozen=True, slots=True)
class _Sample:
    at: float
    accel_b: Sequence[float]
    gyro_b: Sequence[float]


class GuidedMotion:
    """Guided motion of one vehicle by hand: detects when each step is complete, and when the motion has failed.

    Pass each sample of the inertial sensors to `on_imu`, each sent pose to `on_pose`, and call `tick` a few
    times a second.
    step: current step
    since: time at which each step began [s]
    note: what was wrong with the motion in this step, for the person; "" if nothing was
    failure: why the motion cannot be used; "" while it can
    """

    def __init__(self, now: float) -> None:
        self.step = Step.REST
        self.since = {Step.REST: now}
        self.note = self.failure = ""
        self._deadline = now + STEP_TIMEOUT_S
        self._samples: deque[_Sample] = deque()
        self._imu_at = self._pose_at = -math.inf
        self._fastest = self._moved_s = 0.0
        self._level_first = False
        self._wrong_since = math.inf

    @property
    def text(self) -> str:
        """Instruction for the person who moves the vehicle."""
        text = TEXTS[Step.LEVEL] if self._level_first else TEXTS[self.step]
        return f"{self.note}. {text}" if self.note else text

    @property
    def moving(self) -> bool:
        """True from the time at which the person must lift the vehicle until the person has put it down again."""
        return self.step not in (Step.REST, Step.DONE)

    def on_pose(self, now: float) -> None:
        """Record that a pose of the vehicle's own body was sent to the autopilot."""
        self._check_gap("pose of its body", self._pose_at, now)
        self._pose_at = now

    def on_imu(self, accel_b: Sequence[float], gyro_b: Sequence[float], now: float) -> None:
        """Process a sample of accelerometer [m/s2] [FRD] and gyroscope [rad/s] [FRD]."""
        self._check_gap("data of its inertial sensors", self._imu_at, now)
        elapsed_s, self._imu_at = min(now - self._imu_at, GAP_S), now
        self._samples.append(_Sample(now, accel_b, gyro_b))
        while self._samples[0].at < now - _REST_S:
            self._samples.popleft()
        recent = [s for s in self._samples if s.at >= now - _SMOOTHING_S]
        if len(recent) < _MIN_SAMPLES or self.failure:
            return
        accel, rate = _mean([s.accel_b for s in recent]), math.hypot(*_mean([s.gyro_b for s in recent]))
        self._fastest = max(self._fastest, rate)
        if rate > _LIFT_RAD_S or abs(math.hypot(*accel_b) - GRAVITY_M_S2) > _LIFT_M_S2:
            self._moved_s += elapsed_s
        down = measured_down(accel)
        if down is not None:
            self._advance(math.degrees(math.asin(down[0])), math.degrees(math.asin(down[1])), down[2], now)

    def tick(self, now: float) -> None:
        """Mark the motion as failed if data is missing during the motion, or if a step takes too long."""
        self._check_gap("pose of its body", self._pose_at, now)
        self._check_gap("data of its inertial sensors", self._imu_at, now)
        if self.failure or self.step is Step.DONE:
            return
        if self.step is Step.REST:
            self.note = self._missing(now)
        if now > self._deadline:
            still = self.step in (Step.REST, Step.PUT_DOWN)
            missed = "was not level and at rest" if still else "did not move as required"
            why = self.note or f"the vehicle {missed} in the step '{self.step}'"
            self._fail(f"{why} (limit {STEP_TIMEOUT_S:g} s)")

    def _missing(self, now: float) -> str:
        if now - self._imu_at > GAP_S:
            return "No data of the inertial sensors (HIGHRES_IMU)"
        if len(self._samples) < _MIN_SAMPLES / _SMOOTHING_S:
            return f"HIGHRES_IMU is received at less than {_MIN_SAMPLES / _SMOOTHING_S:.0f} Hz"
        return "No pose of its body is sent to the autopilot" if now - self._pose_at > GAP_S else ""

    def _advance(self, nose_deg: float, right_deg: float, down: float, now: float) -> None:
        """Begin the next step if the present step is complete. Call this for each new attitude of the vehicle.

        nose_deg, right_deg: angles of the nose and of the right side below the horizontal [deg]
        down: cosine of the tilt [-]
        """
        level = max(abs(nose_deg), abs(right_deg)) < LEVEL_DEG and down > 0.0
        if self._level_first:
            if level:
                self._level_first, self._fastest = False, 0.0
            return
        if self.step in _TILTS:
            self._tilt(nose_deg, right_deg, now)
        elif self._step_complete(level, now):
            self._next(now)

    def _step_complete(self, level: bool, now: float) -> bool:
        """Return whether the present step is complete. The two tilt steps are checked by `_tilt` instead.

        level: the vehicle is level now
        """
        if self.step is Step.LIFT:
            return self._moved_s >= _LIFT_S
        if self.step is Step.LEVEL:
            return level
        begun = now - self.since[self.step] >= _REST_S
        return begun and level and self._rests(now) and not self._missing(now)

    def _tilt(self, nose_deg: float, right_deg: float, now: float) -> None:
        wanted, across = (nose_deg, right_deg) if self.step is Step.NOSE_DOWN else (right_deg, nose_deg)
        if wanted >= TILT_DEG and abs(across) <= wanted / 2.0:
            if self._fastest < FAST_RAD_S:
                self.note = f"Too slow: {self._fastest:.1f} rad/s, needs {FAST_RAD_S:g}. Level it and tilt it again, faster"
                self._level_first = True
            else:
                self._next(now)
        elif max(abs(nose_deg), abs(right_deg)) < TILT_DEG:
            self._wrong_since = math.inf
        else:
            self._wrong_since = min(self._wrong_since, now)
            if now - self._wrong_since >= _WRONG_S:
                self.note = (
                    f"The autopilot measures {_tilt_words(nose_deg, right_deg)}. If the vehicle really is {self.step}, "
                    "the autopilot is mounted in another direction: set SENS_BOARD_ROT"
                )

    def _rests(self, now: float) -> bool:
        whole = self._samples[0].at <= now - 0.9 * _REST_S
        return whole and all(math.hypot(*s.gyro_b) < _REST_RAD_S for s in self._samples)

    def _next(self, now: float) -> None:
        self.step = ORDER[ORDER.index(self.step) + 1]
        self.since[self.step] = now
        self._deadline = now + STEP_TIMEOUT_S
        self.note, self._fastest, self._moved_s, self._wrong_since = "", 0.0, 0.0, math.inf

    def _check_gap(self, what: str, last: float, now: float) -> None:
        if self.moving and now - last > GAP_S:
            self._fail(f"no {what} for {now - last:.1f} s during the motion (limit {GAP_S:g} s)")

    def _fail(self, why: str) -> None:
        self.failure = self.failure or why


def _mean(vectors: list[Sequence[float]]) -> tuple[float, ...]:
    return tuple(sum(values) / len(vectors) for values in zip(*vectors, strict=True))


def _tilt_words(nose_deg: float, right_deg: float) -> str:
    if abs(nose_deg) >= abs(right_deg):
        return "nose down" if nose_deg > 0 else "nose up"
    return "right side down" if right_deg > 0 else "left side down"
