"""Checks which ROS 2 setpoints and commands may reach one vehicle, and converts them to MAVLink. Pure.

Each message from ROS 2 gives at most one MAVLink message, at once: nothing is sent again. The messages pass the router like those
of a user program, so pilot, land-all and copilot have priority. This module also drops setpoints that are too old or in a frame other
than `map`. After a takeover of the vehicle it drops all setpoints until ROS 2 requests OFFBOARD again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import ned_from_world, q_nb_from_q_wf, quat_normalize, wxyz_from_xyzw, yaw_from_quat
from arena.ros2.dds import Sample
from arena.ros2.messages import Message
from arena.uav.setpoints import Encoder, Ignore
from arena.wire.px4_mode import mode_numbers
from arena.wire.telemetry_values import HeartbeatState

WORLD_FRAME = "map"
MAX_AGE_S = 0.25
"""Age above which a setpoint or command is dropped, and largest lead of the sender's clock [s]."""
CONTROL_MODE_S = 0.5
"""OffboardControlMode is valid for this time [s]."""
_FLIES_S = 1.5
LEAVING_S = 3.0
"""Time after a command of ROS 2 in which the end of OFFBOARD counts as its effect, not as a takeover [s]."""
ARM, SET_MODE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE
_LEAVES_OFFBOARD = frozenset(
    {
        SET_MODE,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_DO_REPOSITION,
    }
)
_WITH_PLACE = frozenset(
    {
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
        mavlink.MAV_CMD_NAV_VTOL_LAND,
        mavlink.MAV_CMD_NAV_ROI,
        mavlink.MAV_CMD_DO_ORBIT,
        mavlink.MAV_CMD_DO_FIGURE_EIGHT,
        mavlink.MAV_CMD_DO_SET_HOME,
        mavlink.MAV_CMD_DO_REPOSITION,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
    }
)
"""Commands of PX4 whose param5 and param6 are latitude and longitude [deg]."""
COMMANDS = ("arm", "disarm", "offboard", "land", "hold")
"""Texts of the topic `command`."""
_MODES = {"offboard": "OFFBOARD", "land": "AUTO.LAND", "hold": "AUTO.LOITER"}
_NO_VALUE = [0.0, 0.0, 0.0]


@dataclass(frozen=True, kw_only=True)
class _Flown:
    """Arming state of a vehicle that ROS 2 flies, from its last HEARTBEAT."""

    armed: bool


class Incoming:
    """Filter and converter of ROS 2 messages to one vehicle.

    name: name of the vehicle. system_id: MAV_SYS_ID.
    dropped: number of dropped messages by reason. events: texts to report, which the caller removes.
    lost: why ROS 2 has lost control of the vehicle; "" if it has not.
    """

    def __init__(self, name: str, system_id: int) -> None:
        self.name, self._id = name, system_id
        self.encoder = Encoder(system_id)
        self.dropped: Counter[str] = Counter()
        self.events: list[str] = []
        self.lost = ""
        self._flown: _Flown | None = None
        self._left_at = self._setpoint_at = -math.inf
        self._mode_at, self._control_mode = -math.inf, frozenset[str]()

    def on_heartbeat(self, heart: HeartbeatState, now: float) -> None:
        """Check whether ROS 2 still controls the vehicle. Call it with every heartbeat of the autopilot.

        now: [s].

        ROS 2 controls the vehicle while the vehicle is in OFFBOARD and setpoints of ROS 2 arrive.
        """
        if heart.mode != "OFFBOARD":
            if self._flown is not None:
                self._lose(f"it left OFFBOARD and is now in {heart.mode}", now)
        elif self._flown is not None and self._flown.armed and not heart.armed:
            self._lose("it was disarmed", now)
        elif now - self._setpoint_at <= _FLIES_S and not self.lost:
            self._flown = _Flown(armed=heart.armed)

    def _lose(self, what: str, now: float) -> None:
        """Drop setpoints from now on, because ROS 2 has lost control of the vehicle.

        ROS 2 keeps control if it has itself commanded the vehicle to leave OFFBOARD or to disarm.
        """
        self._flown = None
        if now - self._left_at <= LEAVING_S:
            return
        self.lost = what
        self.events.append(
            f"{self.name}: ROS 2 has lost control of the vehicle: {what}. Setpoints from ROS 2 are dropped until a node requests OFFBOARD"
        )

    def on_pose(self, sample: Sample, now: float) -> list[mavlink.MAVLink_message]:
        """Convert a `geometry_msgs/PoseStamped` (position and yaw, ENU, frame `map`) to a MAVLink setpoint.

        now: [s].
        """
        if not self._takes_setpoint(sample, now) or not self._in_world(sample.message):
            return []
        pose = sample.message["pose"]
        p_w, q = [pose["position"][k] for k in "xyz"], [pose["orientation"][k] for k in "xyzw"]
        norm = math.hypot(*q)
        if not math.isfinite(norm) or norm < 0.5 or not np.isfinite(p_w).all():
            return self._drop("not finite, or without an orientation")
        yaw = float(yaw_from_quat(q_nb_from_q_wf(quat_normalize(wxyz_from_xyzw(q)))))
        return [self.encoder.pos_yaw(ned_from_world(p_w), yaw, now)]

    def on_velocity(self, sample: Sample, now: float) -> list[mavlink.MAVLink_message]:
        """Convert a `geometry_msgs/TwistStamped` (velocity and yaw rate, ENU, `map`) to a MAVLink setpoint."""
        if not self._takes_setpoint(sample, now) or not self._in_world(sample.message):
            return []
        twist = sample.message["twist"]
        v_w, rate = [twist["linear"][k] for k in "xyz"], twist["angular"]["z"]
        if not np.isfinite([*v_w, rate]).all():
            return self._drop("not finite")
        mask = Ignore.POSITION | Ignore.ACCELERATION | Ignore.YAW
        return [self._local(now, mask, vel=ned_from_world(v_w).tolist(), yaw_rate=-rate)]

    def on_control_mode(self, sample: Sample, now: float) -> None:
        """Store PX4's `OffboardControlMode`, which selects the fields of the trajectory setpoint.

        The message alone is not a setpoint.
        """
        if self._is_current(sample):
            self._mode_at = now
            self._control_mode = frozenset(key for key, value in sample.message.items() if value is True)

    def on_trajectory(self, sample: Sample, now: float) -> list[mavlink.MAVLink_message]:
        """Convert PX4's `TrajectorySetpoint` [NED] to a MAVLink setpoint. Fields that are NaN are ignored.

        It needs an `OffboardControlMode` that is at most 0.5 s old.
        """
        if not self._takes_setpoint(sample, now):
            return []
        if now - self._mode_at > CONTROL_MODE_S:
            return self._drop("no OffboardControlMode in the last 0.5 s")
        if not self._control_mode & {"position", "velocity", "acceleration"}:
            return self._drop("OffboardControlMode without position, velocity and acceleration")
        m, mask, values = sample.message, 0, {}
        for field, key, bits in (
            ("position", "pos", Ignore.POSITION),
            ("velocity", "vel", Ignore.VELOCITY),
            ("acceleration", "acc", Ignore.ACCELERATION),
        ):
            finite = np.isfinite(m[field])
            if not finite.any() or (field == "position" and field not in self._control_mode):
                mask |= bits
            elif finite.all():
                values[key] = [float(x) for x in m[field]]
            else:
                return self._drop(f"{field} with one axis that is not finite")
        if not values:
            return self._drop("no finite position, velocity or acceleration")
        mask |= 0 if math.isfinite(m["yaw"]) else Ignore.YAW
        mask |= 0 if math.isfinite(m["yawspeed"]) else Ignore.YAW_RATE
        yaw, rate = (x if math.isfinite(x) else 0.0 for x in (m["yaw"], m["yawspeed"]))
        return [self._local(now, mask, **values, yaw=yaw, yaw_rate=rate)]

    def on_px4_command(self, sample: Sample, now: float) -> list[mavlink.MAVLink_message]:
        """Convert PX4's `VehicleCommand` to COMMAND_LONG or COMMAND_INT.

        Commands for another system id are dropped.
        """
        if not self._is_current(sample):
            return []
        m = sample.message
        if m["target_system"] not in (0, self._id):
            return self._drop(f"command for another system than {self._id}")
        params = tuple(float(m[f"param{i}"]) for i in range(1, 8))
        return self._command(m["command"], params, now)

    def on_command(self, sample: Sample, now: float) -> list[mavlink.MAVLink_message]:
        """Convert a text command from the topic `command`, one of COMMANDS."""
        if not self._is_current(sample):
            return []
        text = sample.message["data"].strip().lower()
        if text in ("arm", "disarm"):
            return self._command(ARM, (1.0 if text == "arm" else 0.0,), now)
        if text not in _MODES:
            self.events.append(
                f"{self.name}: ROS 2 command: got {text[:40]!r}, expected one of {', '.join(COMMANDS)}"
            )
            return self._drop("unknown command")
        return self._command(SET_MODE, (1.0, *map(float, mode_numbers(_MODES[text]))), now)

    def _command(self, number: int, params: Sequence[float], now: float) -> list[mavlink.MAVLink_message]:
        """Return a command as COMMAND_INT if it contains a position, otherwise as COMMAND_LONG.

        COMMAND_LONG has 32-bit floats, which round latitude and longitude to 0.4 m.

        A place that is not given (NaN) stays in COMMAND_LONG, because PX4 before v1.13 reads INT32_MAX as a number.
        A request for OFFBOARD takes the vehicle back, if the router allows it.
        """
        if number == SET_MODE and params[1] == mode_numbers("OFFBOARD")[0]:
            self.lost = ""
        elif number in _LEAVES_OFFBOARD or (number == ARM and abs(params[0]) < 0.5):
            self._left_at = now
        is_place = (
            number in _WITH_PLACE and len(params) == 7 and abs(params[4]) <= 90.0 and abs(params[5]) <= 180.0
        )
        encode = self.encoder.command_at if is_place else self.encoder.command
        return [encode(number, tuple(params), 0)]

    def _takes_setpoint(self, sample: Sample, now: float) -> bool:
        if self.lost:
            self.dropped["the vehicle was taken from ROS 2"] += 1
            return False
        if not self._is_current(sample):
            return False
        self._setpoint_at = now
        return True

    def _is_current(self, sample: Sample) -> bool:
        if sample.age_s > MAX_AGE_S:
            self.dropped[f"older than {MAX_AGE_S:g} s"] += 1
            return False
        if sample.age_s < -MAX_AGE_S:
            self.dropped["sent in the future: the clocks of the computers differ"] += 1
            return False
        return True

    def _in_world(self, message: Message) -> bool:
        frame = message["header"]["frame_id"]
        if frame != WORLD_FRAME:
            self.dropped[f"in a frame other than {WORLD_FRAME}"] += 1
            return False
        return True

    def _drop(self, why: str) -> list[mavlink.MAVLink_message]:
        self.dropped[why] += 1
        return []

    def _local(
        self,
        now: float,
        mask: int,
        *,
        pos: Sequence[float] = _NO_VALUE,
        vel: Sequence[float] = _NO_VALUE,
        acc: Sequence[float] = _NO_VALUE,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
    ) -> mavlink.MAVLink_message:
        return mavlink.MAVLink_set_position_target_local_ned_message(
            int(now * 1e3) & 0xFFFFFFFF,
            self._id,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            mask,
            *pos,
            *vel,
            *acc,
            math.remainder(yaw, math.tau),
            yaw_rate,
        )
