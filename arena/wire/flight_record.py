"""Layout of `flight.mcap`, the record of a flight: topics, schemas, and conversion of messages.

The conversion is from bytes to values and back.

Structured messages are ROS 2 messages (CDR, little endian), because Foxglove and PlotJuggler read them. All numbers are float64,
so the record is exact. Datagrams of MAVLink are recorded as they are.
"""

from __future__ import annotations

import functools
import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from arena.kernels.record_messages import FrameMessages, StateMessages

Triple = tuple[float, float, float]
Quad = tuple[float, float, float, float]

FILE_NAME = "flight.mcap"
METADATA = "arena"
"""Name of the metadata record with the arena's name, clock and vehicles."""
TAIL_METADATA, TAIL_START = "arena_tail", "after_bytes"
"""Name and key of the metadata record of `flight.mcap.tail`: size of `flight.mcap` [bytes] after which the messages of the tail follow."""
FRAMES_TOPIC, EVENTS_TOPIC = "/mocap/frames", "/events"
MAVLINK_ENCODING, CDR_ENCODING, JSON_ENCODING = "mavlink", "cdr", "json"
SIMULATION_CLOCK, UNIX_CLOCK = "simulation", "unix"
"""Values of `clock` in the metadata: `log_time` is simulation time, or Unix time if a vehicle is real."""


def tail_path(record: Path) -> Path:
    """Return the path of `flight.mcap.tail`, the file with the messages of the unfinished chunk of the record."""
    return record.with_name(f"{record.name}.tail")


def down_topic(vehicle: str) -> str:
    """Return the topic in `flight.mcap` for MAVLink datagrams from a vehicle, such as /uav1/mavlink/down."""
    return f"/{vehicle}/mavlink/down"


def up_topic(vehicle: str) -> str:
    """Return the topic in `flight.mcap` for MAVLink datagrams to a vehicle, such as /uav1/mavlink/up.

    It also contains the references that the vehicle's program publishes.
    """
    return f"/{vehicle}/mavlink/up"


def truth_topic(vehicle: str) -> str:
    """Return the topic in `flight.mcap` for the true states of a simulated vehicle, such as /uav1/truth."""
    return f"/{vehicle}/truth"


@dataclass(frozen=True, kw_only=True)
class RecordedVehicle:
    """Vehicle of the arena, as the metadata of `flight.mcap` describe it.

    name, body: name of the vehicle, and of its rigid body in the motion capture.  id: MAVLink system id.
    simulated: false for a real vehicle.  autopilot: `builtin`, `px4` or `hitl`.  profile: name of its profile.
    """

    name: str
    id: int
    body: str
    simulated: bool
    autopilot: str
    profile: str


def pack_metadata(
    *,
    name: str,
    clock: str,
    start_s: float,
    start_unix_s: float,
    size_m: Sequence[float],
    vehicles: Sequence[RecordedVehicle],
    fence: Mapping[str, Any] | None = None,
    obstacles: Sequence[Mapping[str, Any]] = (),
) -> dict[str, str]:
    """Return the content of the metadata record `arena` in `flight.mcap`.

    name: name of the arena.  clock: `simulation` or `unix`.  start_s, start_unix_s: start of the record by the run's clock, and
    as Unix time [s].  size_m: size of the room, north, east, height [m].
    fence, obstacles: geofence (None without one) and obstacles, as in the configuration (slice) of the recorder.
    """
    return {
        "name": name,
        "clock": clock,
        "start_s": repr(start_s),
        "start_unix_s": repr(start_unix_s),
        "size_m": json.dumps([*size_m]),
        "vehicles": json.dumps([asdict(vehicle) for vehicle in vehicles]),
        "fence": json.dumps(fence),
        "obstacles": json.dumps([dict(obstacle) for obstacle in obstacles]),
    }


@dataclass(frozen=True, kw_only=True)
class MessageSchema:
    """Schema of recorded messages, as MCAP stores it: name, encoding and definition.

    name, encoding: as in the file.
    text: definition of the message.
    """

    name: str
    encoding: str
    text: str

    @property
    def data(self) -> bytes:
        """Definition of the message as bytes."""
        return self.text.encode()


DATAGRAM = MessageSchema(name="mavlink.Datagram", encoding="", text="")
TRUE_STATE = MessageSchema(
    name="arena_msgs/msg/TrueState",
    encoding="ros2msg",
    text="""\
# True state of a simulated vehicle at the log time of the message
float64[3] p_n      # position of the body origin [m] [NED]
float64[3] v_n      # velocity [m/s] [NED]
float64[4] q_nb     # attitude [-] wxyz
float64[3] omega_b  # body rates [rad/s] [FRD]
""",
)
CAPTURED_FRAME = MessageSchema(
    name="arena_msgs/msg/CapturedFrame",
    encoding="ros2msg",
    text=f"""\
# Frame of motion capture. Its log time is the time of reception
uint32 number       # frame number
bool simulated      # the frame is from the motion capture emulator
float64 exposed_s   # time of exposure, by the clock of the motion capture server [s]
float64 sent_s      # time of sending, by the same clock [s]; NaN if unknown
arena_msgs/CapturedBody[] bodies  # ordered by name
{"=" * 80}
MSG: arena_msgs/CapturedBody
string name
bool tracked        # false: position and attitude are NaN
float64[3] p_n      # position of the body origin [m] [NED]
float64[4] q_nb     # attitude [-] wxyz
""",
)
EVENT = MessageSchema(
    name="arena.Event",
    encoding="jsonschema",
    text="""\
{"type": "object", "title": "line of events.jsonl", "properties": {
  "t": {"type": "string", "format": "date-time"},
  "mono": {"type": "number", "description": "monotonic time of the computer [s]"},
  "process": {"type": "string"},
  "event": {"type": "string"}}}
""",
)

_CDR_HEAD_BYTES = 4
_TRUE_STATE = struct.Struct("<4x13d")
TRUE_STATE_BYTES = _TRUE_STATE.size
_ALIGN = 8

pack_true_state = StateMessages().pack
"""Encode the true state of a simulated vehicle as a message of `flight.mcap`. The arguments are the fields of `TRUE_STATE`."""


class RecordedBody(NamedTuple):
    """Rigid body in a recorded motion capture frame: its name and pose.

    name: name of the rigid body.  tracked: whether the cameras have measured its pose.
    p_n: position of its origin [m] [NED].  q_nb: attitude [-] wxyz. NaN if not tracked.
    """

    name: str
    tracked: bool
    p_n: Triple
    q_nb: Quad


class RecordedFrame(NamedTuple):
    """Recorded motion capture frame: the poses of all rigid bodies at one time.

    time_s: time of reception, by the run's clock [s].  number: frame number.
    exposed_s, sent_s: times of exposure and sending, by the clock of the server [s]; NaN if unknown.
    simulated: the frame is from the motion capture emulator.  bodies: bodies, ordered by name.
    """

    time_s: float
    number: int
    exposed_s: float
    sent_s: float
    simulated: bool
    bodies: tuple[RecordedBody, ...]


def pack_frame(
    number: int,
    exposed_s: float,
    sent_s: float,
    simulated: bool,
    poses: Sequence[tuple[str, Triple, Quad]],
    untracked: Sequence[str],
) -> bytes:
    """Encode a motion capture frame as a message of `flight.mcap`.

    number, exposed_s, sent_s, simulated: fields of the schema `CAPTURED_FRAME`.
    poses: (name, p_n, q_nb) of each body that is tracked.  untracked: names of the other bodies.
    """
    names = (*map(_body_name, poses), *untracked)
    return _frame_messages(names, len(poses)).pack(number, exposed_s, sent_s, simulated, poses)


_body_name = itemgetter(0)


@functools.lru_cache(maxsize=64)
def _frame_messages(names: tuple[str, ...], tracked: int) -> FrameMessages:
    return FrameMessages(names, tracked)


_FRAME_HEAD = struct.Struct("<I?3xddI")
_LENGTH, _POSE = struct.Struct("<I"), struct.Struct("<7d")


def unpack_frame(time_s: float, data: bytes) -> RecordedFrame:
    """Decode a motion capture frame from a message of /mocap/frames.

    time_s: time at which the frame was received, by the run's clock [s].
    """
    number, simulated, exposed_s, sent_s, count = _FRAME_HEAD.unpack_from(data, _CDR_HEAD_BYTES)
    bodies = tuple(_bodies(data[_CDR_HEAD_BYTES:], _FRAME_HEAD.size, count))
    return RecordedFrame(time_s, number, exposed_s, sent_s, simulated, bodies)


def _bodies(data: bytes, at: int, count: int) -> Iterator[RecordedBody]:
    for _ in range(count):
        at += -at % _LENGTH.size
        (length,) = _LENGTH.unpack_from(data, at)
        start = at + _LENGTH.size
        end = start + length
        at = end + 1 + -(end + 1) % _ALIGN
        x, y, z, *q_nb = _POSE.unpack_from(data, at)
        at += _POSE.size
        name = str(data[start : end - 1], "utf-8")
        yield RecordedBody(name, data[end] != 0, (x, y, z), (q_nb[0], q_nb[1], q_nb[2], q_nb[3]))
