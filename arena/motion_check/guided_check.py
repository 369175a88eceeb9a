"""Identity and axes check of one vehicle: guides a person through motions, and decides pass or fail. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from arena.motion_check.guided_motion import GuidedMotion, Step
from arena.motion_check.recording import Recording
from arena.motion_check.verdict import Verdict, judge


class GuidedCheck:
    """Guided check that a captured rigid body belongs to a vehicle, and that both have the same axes.

    A person moves the vehicle by hand. The check ends with a verdict.

    Pass in the data with `on_imu`, `on_pose` and `on_other`, and call `tick` a few times a second.
    body: name of the vehicle's own rigid body
    limit_deg: largest rotation between captured and measured axes [deg]
    verdict: result; None while the check continues
    """

    def __init__(self, body: str, limit_deg: float, now: float) -> None:
        self._body, self._limit_deg = body, limit_deg
        self._motion, self._recorded = GuidedMotion(now), Recording()
        self.verdict: Verdict | None = None

    @property
    def step(self) -> Step:
        """Step of the motion that the person must carry out now."""
        return self._motion.step

    @property
    def text(self) -> str:
        """Instruction for the person who moves the vehicle."""
        return self._motion.text

    def on_imu(self, accel_b: Sequence[float], gyro_b: Sequence[float], boot_s: float, now: float) -> None:
        """Process a sample of the inertial sensors.

        boot_s: time of the sample by the autopilot's clock [s]. now: time of arrival [s].
        """
        if self.verdict is None and all(map(math.isfinite, (*accel_b, *gyro_b))):
            self._recorded.add_imu(now, boot_s, accel_b, gyro_b)
            self._motion.on_imu(accel_b, gyro_b, now)

    def on_pose(self, q_nb: Sequence[float], p_n: Sequence[float], now: float) -> None:
        """Store a captured pose of the vehicle. Call this method when the pose is sent to the autopilot."""
        norm = math.sqrt(sum(x * x for x in q_nb))
        if self.verdict is None and math.isfinite(norm) and norm > 0.5:
            self._recorded.add_pose(now, tuple(x / norm for x in q_nb), tuple(p_n))
            self._motion.on_pose(now)

    def on_other(self, body: str, q_nb: Sequence[float], now: float) -> None:
        """Store the attitude of a captured body that is not the vehicle's own. now: time of arrival [s]."""
        if self.verdict is None and body != self._body:
            self._recorded.add_other(body, now, q_nb)

    def tick(self, now: float, offset_s: float | None) -> None:
        """End the check if the motion is complete or has failed, and compute the verdict.

        offset_s: this computer's clock minus the autopilot's clock [s].
        """
        if self.verdict is not None:
            return
        self._motion.tick(now)
        if self._motion.failure:
            self.stop(self._motion.failure)
        elif self._motion.step is Step.DONE:
            self.verdict = judge(self._body, self._motion, self._recorded, offset_s, self._limit_deg)

    def stop(self, why: str) -> None:
        """End the check without a result.

        why: reason for the user
        """
        if self.verdict is None:
            self.verdict = Verdict(problems=(why,))
