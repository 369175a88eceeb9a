"""Table of the columns of a log, `csv/<vehicle>.csv`.

A group is one measured quantity. It has one column per component, such as north, east, down. The columns of a log are in the
order of this table.

The groups in THESIS have the same names and the same order as in the log files of the thesis from which `arena` was
developed, so that scripts for those files can read logs of arena. A cell is empty if the value was not received, is too
old, or is not controlled.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

from arena.constants import MAX_ROTORS

NED = ("north", "east", "down")
RPY = ("roll", "pitch", "yaw")
WXYZ = ("w", "x", "y", "z")

Instant = Literal["row", "interpolated", "held"]

SETPOINT_MAX_AGE_S, STATE_MAX_AGE_S, BATTERY_MAX_AGE_S = 0.5, 3.0, 10.0
"""Age above which a setpoint, a state and the battery charge are no longer written to a row [s]."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """A measured quantity and the names of its columns in a log, such as `ekf.pos.north`.

    There is one column per component. A quantity without components has one column with the name of the
    quantity, such as `info.battery`.

    instant: time to which the value of a row belongs. "interpolated": between two samples, for the time of the row;
        "held": value of the last message; "row": exactly the time of the row.
    source: message or process from which the values come.  meaning: text for the reference page.
    """

    name: str
    parts: tuple[str, ...] = ()
    unit: str
    frame: str = "-"
    source: str
    instant: Instant
    meaning: str

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of this quantity, such as `ekf.pos.north`."""
        return tuple(f"{self.name}.{part}" for part in self.parts) or (self.name,)


_POSITION, _ATTITUDE, _IMU = "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "HIGHRES_IMU"
_TARGET, _ATTITUDE_TARGET = "POSITION_TARGET_LOCAL_NED", "ATTITUDE_TARGET"
_MOCAP, _TRUTH = "motion capture", "simulated world"
_ESTIMATOR, _ULOG = "ESTIMATOR_STATUS or ULog", "ULog"
_WIND = "wind velocity, estimated by the autopilot; empty without an estimate: only PX4 with EKF2_DRAG_CTRL 1 has one"
_RATIO = "innovation divided by its limit; above 1 the measurement is rejected"


def _group(
    instant: Instant, name: str, parts: tuple[str, ...], unit: str, frame: str, source: str, meaning: str
) -> Group:
    return Group(
        name=name, parts=parts, unit=unit, frame=frame, source=source, instant=instant, meaning=meaning
    )


_interpolated = functools.partial(_group, "interpolated")
_held = functools.partial(_group, "held")
_exact = functools.partial(_group, "row")


THESIS: tuple[Group, ...] = (
    _exact(
        "time.seconds", (), "s", "-", "clock", "time of the row: simulation time, or unix time for a real vehicle"
    ),
    _interpolated("ekf.pos", NED, "m", "NED", _POSITION, "estimated position of the body origin"),
    _interpolated("ekf.vel", NED, "m/s", "NED", _POSITION, "estimated velocity"),
    _interpolated("ekf.vel_body", NED, "m/s", "FRD", "computed", "`ekf.vel` rotated into body axes with `ekf.att_q`"),
    _interpolated("ekf.att_q", WXYZ, "-", "NED from FRD", _ATTITUDE, "estimated attitude, Hamilton"),
    _interpolated("ekf.att_euler", RPY, "rad", "NED from FRD", "computed", "`ekf.att_q` as Euler angles"),
    _interpolated("ekf.ang_vel", RPY, "rad/s", "FRD", _ATTITUDE, "estimated body rates"),
    _interpolated("imu.acc_body", NED, "m/s2", "FRD", _IMU, "specific force"),
    _interpolated("imu.ang_vel", RPY, "rad/s", "FRD", _IMU, "body rates of the gyroscope"),
    _interpolated("imu.mag", NED, "T", "FRD", _IMU, "magnetic field"),
    _interpolated("mocap.pos", NED, "m", "NED", _MOCAP, "position of the body origin, measured by the cameras"),
    _interpolated("mocap.att_q", WXYZ, "-", "NED from FRD", _MOCAP, "attitude, measured by the cameras"),
    _interpolated("mocap.att_euler", RPY, "rad", "NED from FRD", "computed", "`mocap.att_q` as Euler angles"),
    _held("info.flight_mode", (), "-", "-", "HEARTBEAT", "PX4's name of the flight mode: `OFFBOARD`, `AUTO.LAND`"),
    _held("info.is_armed", (), "-", "-", "HEARTBEAT", "`True` or `False`"),
    _held("info.is_landed", (), "-", "-", "EXTENDED_SYS_STATE", "`True` or `False`, from the land detector"),
    _held("info.battery", (), "%", "-", "SYS_STATUS", "remaining charge"),
    _held(
        "pos_ref",
        NED,
        "m",
        "NED",
        f"program, else {_TARGET}",
        "position reference: the values that the program publishes with `uav.reference`, else the autopilot's setpoint",
    ),
    _held("att_euler_ref", RPY, "rad", "NED from FRD", "computed", "`att_q_ref` as Euler angles"),
)  # fmt: skip

FURTHER: tuple[Group, ...] = (
    _held("pos_ref.yaw", (), "rad", "NED", f"program, else {_TARGET}", "yaw reference"),
    _held("vel_ref", NED, "m/s", "NED", f"program, else {_TARGET}", "velocity reference"),
    _held("att_q_ref", WXYZ, "-", "NED from FRD", _ATTITUDE_TARGET, "attitude setpoint"),
    _held("ang_vel_ref", RPY, "rad/s", "FRD", _ATTITUDE_TARGET, "body rate setpoint"),
    _held("thrust_ref", (), "-", "FRD", _ATTITUDE_TARGET, "collective thrust setpoint, 0..1"),
    _interpolated("baro.pressure", (), "Pa", "-", _IMU, "absolute pressure"),
    _interpolated("baro.temperature", (), "deg C", "-", _IMU, "temperature of the barometer"),
    _interpolated("baro.alt", (), "m", "-", _IMU, "pressure altitude"),
    _held(
        "act.output",
        tuple(str(k + 1) for k in range(MAX_ROTORS)),
        "-",
        "-",
        "SERVO_OUTPUT_RAW or ACTUATOR_CONTROL_TARGET",
        "actuator outputs 1 to 8, 0..1; unused outputs are 0",
    ),
    _held("bat.voltage", (), "V", "-", "SYS_STATUS", "voltage of the battery"),
    _held("bat.current", (), "A", "-", "SYS_STATUS", "current out of the battery"),
    _held("ekf.test_ratio", ("vel", "pos", "height", "yaw"), "-", "-", _ESTIMATOR, f"{_RATIO}; yaw: of heading or magnetometer"),
    _held("ekf.accuracy", ("horizontal", "vertical"), "m", "-", _ESTIMATOR, "standard deviation of the estimated position"),
    _held("ekf.innov_pos", NED, "m", "NED", _ULOG, "innovation of the position: estimate minus measurement"),
    _held("ekf.innov_vel", NED, "m/s", "NED", _ULOG, "innovation of the velocity"),
    _held("ekf.innov_yaw", (), "rad", "NED", _ULOG, "innovation of the heading"),
    _held("ekf.gyro_bias", RPY, "rad/s", "FRD", _ULOG, "estimated bias of the gyroscope"),
    _held("ekf.acc_bias", NED, "m/s2", "FRD", _ULOG, "estimated bias of the accelerometer"),
    _held("wind", ("north", "east"), "m/s", "NED", "WIND_COV or ULog", _WIND),
)  # fmt: skip

TRUTH: tuple[Group, ...] = (
    _exact("truth.pos", NED, "m", "NED", _TRUTH, "position of the body origin"),
    _exact("truth.vel", NED, "m/s", "NED", _TRUTH, "velocity"),
    _exact("truth.att_q", WXYZ, "-", "NED from FRD", _TRUTH, "attitude, Hamilton"),
    _exact("truth.att_euler", RPY, "rad", "NED from FRD", "computed", "`truth.att_q` as Euler angles"),
    _exact("truth.ang_vel", RPY, "rad/s", "FRD", _TRUTH, "body rates"),
    _interpolated("err.pos", NED, "m", "NED", "computed", "`ekf.pos` minus `truth.pos`"),
    _interpolated("err.vel", NED, "m/s", "NED", "computed", "`ekf.vel` minus `truth.vel`"),
    _interpolated("err.att_euler", RPY, "rad", "FRD", "computed", "rotation vector from the true attitude to the estimated attitude"),
)  # fmt: skip
"""Columns of the true state from the simulated world. Only logs of simulated vehicles have them."""


def columns(simulated: bool) -> tuple[str, ...]:
    """Return the names of all columns of a log, in the order of the file.

    simulated: True includes the columns of the true state.
    """
    groups = THESIS + FURTHER + (TRUTH if simulated else ())
    return tuple(column for group in groups for column in group.columns)


PAGE_HEAD = """\
Each vehicle's log is `csv/<vehicle>.csv` in the run folder. It has one header line, and then `log.rate_hz`
rows per second (default 30). After a flight it is computed from the record of the flight, `flight.mcap`, which contains all messages.

- An empty cell means that the value was not received, is too old, or is not controlled in this mode.
- Units are SI. Angles are in radians.
- Quaternions are Hamilton, `w x y z`, and rotate FRD body vectors into NED.

**All values of a row belong to one instant**, `time.seconds`. The groups of values arrive at different rates and
with different delays. The column `instant` says how the value for this time is found:

- `row`: the value is exact at this time.
- `interpolated`: the value is interpolated between the samples before and after this time, by the time stamps of the
  sender (`time_boot_ms` or `time_usec` of the autopilot, the exposure time of a motion-capture frame). Positions are
  interpolated with the velocities at both samples, attitudes by the shortest rotation. Samples more than 0.5 s apart
  are not interpolated.
- `held`: the last value before this time. The cell is empty if that value is older than 0.5 s (setpoints), 3 s
  (mode, armed, landed, health of the estimator) or 10 s (battery, biases).
- Columns with the source ULog are empty if the run has no ULog of the vehicle.

The clocks of a real autopilot and of a camera server differ from this computer's clock. Their time stamps
are converted: it is assumed that the message with the smallest delay had no delay. So the times of a real vehicle are too
late by this smallest delay: about 1 ms on Ethernet, several ms by radio. In simulation all time stamps are simulation
time.
"""
PAGE_EXAMPLE = """\
## Read it with pandas

```python
import numpy as np
import pandas as pd

log = pd.read_csv("uav1.csv")
flown = log[log["info.flight_mode"] == "OFFBOARD"]


def ned(group: str) -> np.ndarray:
    return flown[[f"{group}.north", f"{group}.east", f"{group}.down"]].to_numpy()


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean((error**2).sum(axis=1))))


tracking = rms(ned("truth.pos") - ned("pos_ref"))
estimate = rms(ned("ekf.pos") - ned("truth.pos"))
print(f"tracking error: {tracking:.3f} m rms, estimate: {estimate:.3f} m rms")
```

Use `mocap.pos` in place of `truth.pos` for a real vehicle.
"""
