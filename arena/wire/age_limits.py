"""Age limits of MAVLink messages to a vehicle: messages that have waited longer are dropped. Pure.

A process that was stalled drops the messages that have become older than their limit while they waited.

The age of a message is the time since the kernel of this computer received it. A process that is not stalled reads a
message within milliseconds, so the limits do not concern it, whatever the speed of the simulation is.

    class         messages                                            limit   reason
    pose          ODOMETRY and the older messages for external        0.1 s   the autopilot takes the arrival time as the
                  vision                                                      time of the pose; 0.1 s at 2 m/s is 0.2 m
    setpoint      SET_POSITION_TARGET, SET_ATTITUDE_TARGET, ...       0.2 s   a replayed setpoint flies the vehicle back;
                                                                              PX4 waits longer than this for the next one
    manual input  MANUAL_CONTROL, RC_CHANNELS_OVERRIDE                0.2 s   a stick position that the pilot has left
    all others    commands, parameters, missions, heartbeats          1 s     senders repeat them after 0.5 s or more
"""

from __future__ import annotations

from arena.wire.mavlink_frame import Buffer, parse_frames

POSES = frozenset({101, 102, 103, 104, 138, 331})
"""GLOBAL_VISION_POSITION_ESTIMATE, VISION_POSITION_ESTIMATE, VISION_SPEED_ESTIMATE, VICON_POSITION_ESTIMATE,
ATT_POS_MOCAP, ODOMETRY."""
SETPOINTS = frozenset({82, 84, 86, 139})
"""SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, SET_ACTUATOR_CONTROL_TARGET."""
MANUAL_INPUTS = frozenset({69, 70})
"""MANUAL_CONTROL, RC_CHANNELS_OVERRIDE."""

POSE_LIMIT_S = 0.1
SETPOINT_LIMIT_S = 0.2
OTHER_LIMIT_S = 1.0
SHORTEST_LIMIT_S = POSE_LIMIT_S
_LIMITS_S = {
    **dict.fromkeys(POSES, POSE_LIMIT_S),
    **dict.fromkeys(SETPOINTS | MANUAL_INPUTS, SETPOINT_LIMIT_S),
}


def age_limit_s(msgid: int) -> float:
    """Return the age above which a message to a vehicle is dropped [s]."""
    return _LIMITS_S.get(msgid, OTHER_LIMIT_S)


def without_old_frames(data: Buffer, age_s: float) -> tuple[bytes, int]:
    """Remove the frames that are too old from a datagram to a vehicle.

    Return the other frames and the number of removed frames.

    age_s: age of the datagram [s]
    """
    frames = parse_frames(data).frames
    young = [bytes(data[f.start : f.end]) for f in frames if age_s <= age_limit_s(f.msgid)]
    return b"".join(young), len(frames) - len(young)
