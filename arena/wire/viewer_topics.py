"""Table of the topics for Foxglove and PlotJuggler: name, message and rate of each. Pure.

docs/reference/channels.md is made from this table. The topics of the raw record are in `arena.wire.flight_record`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from arena.wire import viewer_messages as messages
from arena.wire.viewer_messages import NumberMessage

VIEW_HZ, SLOW_HZ, SCENE_PERIOD_S = 15.0, 1.0, 5.0


class Content(StrEnum):
    """Kinds of topics for Foxglove and PlotJuggler. Each value is a topic's name without the vehicle's name.

    `VEHICLE_TOPICS` and `ARENA_TOPICS` describe each of them.
    """

    LOCAL_POSITION = "local_position"
    ATTITUDE = "attitude"
    POSITION_SETPOINT = "position_setpoint"
    PROGRAM_REFERENCE = "program_reference"
    ATTITUDE_SETPOINT = "attitude_setpoint"
    ACTUATORS = "actuators"
    IMU = "imu"
    BATTERY = "battery"
    ESTIMATOR = "estimator"
    WIND = "wind"
    STATE = "state"
    LINK = "link"
    BODY_HEALTH = "mocap/health"
    ESTIMATED_POSE = "estimate/pose"
    CAPTURED_POSE = "mocap/pose"
    TRUE_POSE = "truth/pose"
    SETPOINT_POSE = "setpoint/pose"
    MODEL = "model"
    PATH = "path"
    LOG = "log"
    FAULTS = "faults"
    TRANSFORMS = "tf"
    SCENE = "scene"
    MOCAP_HEALTH = "mocap/frames/health"


@dataclass(frozen=True, kw_only=True)
class Topic:
    """Topic for Foxglove and PlotJuggler: its message, content and rate.

    schema: name of the messages' schema.  numbers: message of numbers; None for messages of Foxglove, and with texts.
    rate_hz: largest rate [Hz]; faster messages are left out. None: each message is published.
    when: text for people that says when a message is published.  what: content of the messages.
    """

    schema: str
    what: str
    when: str = ""
    numbers: NumberMessage | None = None
    rate_hz: float | None = None


def _numbers(message: NumberMessage, rate_hz: float | None = None, when: str = "", what: str = "") -> Topic:
    each = "each message" if rate_hz is None else f"at most {rate_hz:g} Hz"
    return Topic(
        schema=message.name, what=what or message.summary, when=when or each, numbers=message, rate_hz=rate_hz
    )


def _pose(what: str) -> Topic:
    return Topic(schema="foxglove.PoseInFrame", what=what, when=f"at most {VIEW_HZ:g} Hz", rate_hz=VIEW_HZ)


_REGULAR = f"every {1 / SLOW_HZ:g} s"
_SCENE = f"at the start and every {SCENE_PERIOD_S:g} s, so that a viewer that connects late receives it"
VEHICLE_TOPICS: dict[Content, Topic] = {
    Content.LOCAL_POSITION: _numbers(messages.LOCAL_POSITION, VIEW_HZ),
    Content.ATTITUDE: _numbers(messages.ATTITUDE, VIEW_HZ),
    Content.POSITION_SETPOINT: _numbers(messages.POSITION_SETPOINT, VIEW_HZ),
    Content.PROGRAM_REFERENCE: _numbers(
        messages.POSITION_SETPOINT,
        VIEW_HZ,
        what="Reference that the user program publishes, as POSITION_TARGET_LOCAL_NED",
    ),
    Content.ATTITUDE_SETPOINT: _numbers(messages.ATTITUDE_SETPOINT, VIEW_HZ),
    Content.ACTUATORS: _numbers(messages.ACTUATORS, VIEW_HZ),
    Content.IMU: _numbers(messages.IMU, VIEW_HZ),
    Content.BATTERY: _numbers(messages.BATTERY, SLOW_HZ),
    Content.ESTIMATOR: _numbers(messages.ESTIMATOR),
    Content.WIND: _numbers(messages.WIND, SLOW_HZ),
    Content.STATE: Topic(
        schema=messages.STATE_NAME,
        what="Flight mode, armed, landed and state of the autopilot, from HEARTBEAT and EXTENDED_SYS_STATE",
        when=f"at each change and {_REGULAR}",
    ),
    Content.LINK: _numbers(messages.LINK, SLOW_HZ, _REGULAR),
    Content.BODY_HEALTH: _numbers(messages.BODY_HEALTH, SLOW_HZ, _REGULAR),
    Content.ESTIMATED_POSE: _pose("Estimated pose in the frame `arena`"),
    Content.CAPTURED_POSE: _pose("Pose from the motion capture in the frame `arena`"),
    Content.TRUE_POSE: _pose("True pose of a simulated vehicle in the frame `arena`"),
    Content.SETPOINT_POSE: _pose("Position setpoint with its yaw in the frame `arena`"),
    Content.MODEL: Topic(
        schema="foxglove.SceneUpdate", what="Model of the vehicle in the frame of its estimate", when=_SCENE
    ),
    Content.PATH: Topic(
        schema="foxglove.SceneUpdate",
        what="Piece of the flown path (blue) and of the setpoints (orange)",
        when=_REGULAR,
    ),
}
ARENA_TOPICS: dict[Content, Topic] = {
    Content.LOG: Topic(
        schema="foxglove.Log",
        what="STATUSTEXT of the vehicles, and lines of events.jsonl: events, changes of processes",
        when="each",
    ),
    Content.FAULTS: Topic(schema=messages.FAULT_NAME, what="Injected faults", when="each"),
    Content.TRANSFORMS: Topic(
        schema="foxglove.FrameTransform",
        what="Frames `<v>` (estimate), `<v>/truth` and `<v>/mocap` in the frame `arena`",
        when=f"with each pose, at most {VIEW_HZ:g} Hz",
        rate_hz=VIEW_HZ,
    ),
    Content.SCENE: Topic(
        schema="foxglove.SceneUpdate", what="Floor, walls, geofence and obstacles", when=_SCENE
    ),
    Content.MOCAP_HEALTH: _numbers(messages.MOCAP_HEALTH, SLOW_HZ, _REGULAR),
}


def topic_name(content: Content, vehicle: str | None = None) -> str:
    """Return the name of a topic, such as "/uav1/imu".

    vehicle: name of the vehicle; None for a topic of the arena.
    """
    return f"/{content}" if vehicle is None else f"/{vehicle}/{content}"
