"""Identity and axes check of a real vehicle that a person moves by hand.

The captured body must move as the vehicle's IMU measures.

Without the record of a passed check, the vehicle must not arm. Pure.

`arena preflight` starts the check. It runs only while the vehicle is disarmed, and it never arms: while it runs, arming is
refused, because a person holds the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.axes_record import AxesRecord, BootTime
from arena.fcu_link.axes_report import DELAY_PARAM, Measured, report_lines
from arena.fcu_link.clock_offset import ClockOffset
from arena.fcu_link.settings import Settings
from arena.mocap.client import CapturedFrame
from arena.mocap.client.lateness import Lateness
from arena.motion_check.guided_check import GuidedCheck
from arena.wire.mavlink_frame import AUTOPILOT

IMU_HZ = 50.0
"""Rate of HIGHRES_IMU during a check [Hz]."""
_PARAM_S = 1.0
_STALE_S = 0.1
_MISSING_S = 10.0
_ROOM_UNSEEN = (
    "link.<vehicle> received no frames of the motion capture itself, so the other bodies of the room were not compared. "
    "Check the firewall and `mocap.local`, then repeat the check"
)


class AxesCheck:
    """Identity and axes check of one real vehicle, which a person moves by hand as instructed.

    The captured rigid body must be that of the vehicle (identity) and must have the axes of its IMU (axes).

    running: a check is running
    events: messages for the user; the caller takes them and empties the list
    status: state of the last check, for `arena preflight`: `number` (differs for each check), `state` (idle, running,
        passed or failed), `text` (what the person must do now), `lines` (result)
    """

    def __init__(self, settings: Settings, record: AxesRecord | None = None) -> None:
        self._s, self._required = settings, settings.preflight.axes_check
        self._record = record
        self.events: list[str] = []
        self.status: dict[str, Any] = {"number": 0, "state": "idle", "text": "", "lines": []}
        self._check: GuidedCheck | None = None
        self._by = self._definition = self._last_known = self._uid = ""
        self._boot: BootTime | None = None
        self._computer, self._suspended_s, self._date = "", 0.0, ""
        self._clock, self._lateness = ClockOffset(), Lateness(_STALE_S)
        self._delay_param: float | None = None
        self._param_asked = self._started = -math.inf
        self._room_seen = False

    @property
    def running(self) -> bool:
        return self._check is not None

    @property
    def record(self) -> AxesRecord | None:
        """Record of the last passed check; None if a later check has failed or none has passed.

        None while a check runs, so that the file contains no record if this process dies in the check.
        """
        return None if self.running else self._record

    @property
    def boot(self) -> BootTime | None:
        """Time at which the autopilot booted; None if unknown, or if it may have booted since."""
        return self._boot

    def reasons(self, uid: str) -> list[str]:
        """Return why the vehicle's axes check forbids arming; empty if arming is allowed.

        uid: hardware uid of the vehicle's autopilot
        """
        if self.running:
            return ["the axes check is running"]
        if not self._required:
            return []
        if self.record is None:
            return [f"no axes check: run arena preflight {self._s.vehicle}"]
        if not self._definition:
            return ["definition of its body not received yet"]
        if self._boot is None:
            return ["boot time of the autopilot not received"]
        changed = self.record.difference(uid, self._s.body, self._definition, self._boot)
        return [f"{changed}: run arena preflight {self._s.vehicle}"] if changed else []

    # -- requests

    def on_request(
        self, request: Mapping[str, Any], now: float, refusal: str, uid: str, *, armed: bool
    ) -> None:
        """Process a request of the supervisor: start or stop an axes check, or store the rigid body's definition.

        refusal: why no check may start now; "" if it may. uid: hardware uid of the autopilot.
        """
        match request.get("do"):
            case "body":
                self.on_definition(str(request.get("definition") or ""))
            case "axes_check":
                refusal = "it is armed: nobody must lift an armed vehicle" if armed else refusal
                self.start(str(request.get("by")), now, refusal, uid)
            case "stop_axes_check":
                self.stop(f"stopped by {request.get('by')}")

    def start(self, by: str, now: float, refusal: str, uid: str) -> None:
        """Start an axes check, or report why it must not start.

        by: person who requested the check. refusal: why the check must not run; "" if it may. uid: hardware uid of the
        autopilot.
        """
        if not self._s.preflight.poses:
            refusal = refusal or "the vehicle gets no poses (forward: false), so there is nothing to compare"
        self.stop("another check was started")
        self._by, self._uid, self._started = by, uid, now
        self._clock, self._lateness = ClockOffset(), Lateness(_STALE_S)
        self._delay_param, self._param_asked, self._room_seen = None, -math.inf, False
        self.status = {"number": int(now * 1e3), "state": "running", "text": "", "lines": []}
        self._check = GuidedCheck(self._s.body, self._s.preflight.tilt_deg, now)
        if refusal:
            self.stop(refusal)
        else:
            self.events.append(f"axes check started by {by}")
            self._show()

    def stop(self, why: str) -> None:
        """End a running axes check without a result; do nothing if no check runs."""
        if self._check is not None:
            self._check.stop(why)
            self._finish()

    # -- the vehicle and its body

    def set_time(self, computer: str, suspended_s: float, date: str) -> None:
        """Store the date, the boot id of this computer and how long it was suspended, for the record of a check.

        computer: boot id of this computer
        suspended_s: time in suspend since the boot [s]
        date: present date and time (ISO 8601, UTC)
        """
        self._computer, self._suspended_s, self._date = computer, suspended_s, date

    def on_definition(self, definition: str) -> None:
        """Store the definition of the rigid body that the pose forwarder has reported.

        definition: "" while it is unknown
        """
        if definition and self._last_known and definition != self._last_known:
            self.stop("the rigid body was defined again during the check")
            self.events.append("its rigid body was defined again: the axes check is not valid any more")
        self._definition = definition
        self._last_known = definition or self._last_known

    def on_boot_time(self, boot_s: float, now: float) -> None:
        """Store how long the autopilot has been running.

        boot_s: time since the autopilot's start [s]. now: time of arrival [s].
        """
        self._boot = BootTime(computer=self._computer, at_s=now + self._suspended_s - boot_s)

    def on_reboot(self) -> None:
        """Discard the stored boot time after a reboot or exchange of the autopilot, and stop a running check."""
        self.stop("the autopilot has rebooted")
        self._boot = None

    def on_autopilot(self, m: Any, now: float) -> None:
        """Process a HIGHRES_IMU, TIMESYNC or PARAM_VALUE message of the autopilot; ignore other messages."""
        if self._check is None:
            return
        kind = m.get_type()
        if kind == "HIGHRES_IMU":
            accel, gyro = (m.xacc, m.yacc, m.zacc), (m.xgyro, m.ygyro, m.zgyro)
            self._check.on_imu(accel, gyro, m.time_usec / 1e6, now)
        elif kind == "TIMESYNC":
            self._clock.on_timesync(m, now)

    def on_param(self, name: str, value: float) -> None:
        """Store the value of EKF2_EV_DELAY that the autopilot has sent. Ignore other parameters."""
        if name == DELAY_PARAM:
            self._delay_param = value

    def on_pose(self, m: Any, now: float) -> None:
        """Use a captured pose in a running axes check. The same pose is sent to the vehicle as ODOMETRY."""
        if self._check is not None:
            self._check.on_pose(m.q, (m.x, m.y, m.z), now)

    def on_frames(self, frames: Sequence[CapturedFrame], now: float) -> None:
        """Use captured frames, which contain all bodies of the room, in a running axes check.

        now: time of arrival [s]
        """
        if self._check is None:
            return
        for frame in frames:
            self._lateness.measure_frame(frame, now, flying=False)
            for pose in frame.poses:
                self._room_seen = self._room_seen or pose.body == self._s.body
                self._check.on_other(pose.body, pose.q_nb, now)

    # -- periodic

    def tick(self, now: float) -> None:
        """Advance a running axes check: evaluate its data, and end the check when it has passed or failed.

        Call this method about twenty times a second.
        """
        if self._check is None:
            return
        if self._missing:
            if now - self._started > _MISSING_S:
                self.stop(f"{self._missing} for {_MISSING_S:g} s")
            return
        self._check.tick(now, self._clock.offset_s)
        if self._check.verdict is not None:
            self._finish()
        else:
            self._show()

    def due(self, now: float) -> list[Any]:
        """Return the messages that the axes check must send to the autopilot now."""
        if self._check is None:
            return []
        due = [m] if (m := self._clock.request(now)) is not None else []
        if self._delay_param is None and now - self._param_asked >= _PARAM_S:
            self._param_asked = now
            due.append(
                mavlink.MAVLink_param_request_read_message(self._s.id, AUTOPILOT, DELAY_PARAM.encode(), -1)
            )
        return due

    @property
    def _missing(self) -> str:
        """Return which data for the record of an axes check are still missing, as text; "" for none."""
        if not self._definition:
            return "the pose forwarder has not reported the definition of the rigid body"
        return "the autopilot has not sent its time since boot (SYSTEM_TIME)" if self._boot is None else ""

    def _show(self) -> None:
        assert self._check is not None
        text = self._missing or self._check.text
        if self.status["text"] != text:
            self.status = {**self.status, "text": text}

    def _finish(self) -> None:
        assert self._check is not None and self._check.verdict is not None
        verdict, self._check = self._check.verdict, None
        if verdict.passed and not self._room_seen:
            verdict = replace(verdict, problems=(_ROOM_UNSEEN,))
        lines = list(verdict.problems)
        if verdict.passed:
            measured = Measured(
                latency_s=self._lateness.latency_s,
                latency_error_s=self._lateness.clock_error_s,
                round_trip_s=self._clock.round_trip_s,
                delay_param=self._delay_param,
                date=self._date[:10],
            )
            lines = report_lines(self._s.vehicle, verdict, self._s.preflight.tilt_deg, measured)
            assert self._boot is not None and verdict.own is not None and verdict.axes is not None
            self._record = AxesRecord(
                vehicle=self._s.vehicle,
                uid=self._uid,
                body=self._s.body,
                definition=self._definition,
                boot=self._boot,
                by=self._by,
                when=self._date,
                turned_deg=round(verdict.axes.turned_deg, 1),
                correlation=round(verdict.own.correlation, 3),
                delay_ms=None if verdict.delay_s is None else round(1e3 * verdict.delay_s, 1),
            )
        elif verdict.own is not None:  # the motion was complete, so the check has a result
            self._record = None
        state = "passed" if verdict.passed else "failed"
        self.status = {**self.status, "state": state, "text": "", "lines": lines}
        self.events.append(f"axes check {state}: {'; '.join(line.strip() for line in lines)}")
