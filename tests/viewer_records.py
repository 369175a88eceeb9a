"""Records with the channels for viewers, made without a flight, and their messages as the package `mcap` decodes them."""

from __future__ import annotations

import io
import math
from collections import defaultdict
from functools import cached_property
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from pymavlink.dialects.v20 import common as mavlink
from recorded_flights import OFFBOARD, stream

from arena.geometry import quat_from_euler
from arena.kernels.mcap_messages import MessageBuffer, MessageChannel
from arena.mocap.client import CapturedFrame, Pose
from arena.obstacles import Obstacle
from arena.recorder.foxglove_channels import FoxgloveChannels, ViewedVehicle
from arena.recorder.mcap_file import Log
from arena.recorder.mcap_records import Definitions, IndexedFile, SchemaData
from arena.recorder.viewer_scene import VehicleShape
from arena.wire.truth_page import Truth

SHAPE = VehicleShape(
    rotors=((0.13, 0.13, -0.03), (-0.13, -0.13, -0.03), (0.13, -0.13, -0.03), (-0.13, 0.13, -0.03)),
    rotor_radius_m=0.11,
    height_m=0.2,
)
UAV1 = ViewedVehicle(name="uav1", id=1, body="body1", index=0, shape=SHAPE)
SIZE_M = (8.0, 6.0, 3.0)
FENCE = ((-3.0, 3.0), (-2.0, 2.0), (0.0, 2.5))
OBSTACLES = (
    Obstacle(
        name="shelf", shape="box", size_m=(1.0, 0.4, 1.8), centre_n=(1.0, -2.0, -0.9), rpy_rad=(0.1, 0.2, 0.3)
    ),
    Obstacle(
        name="pole", shape="cylinder", size_m=(0.3, 0.3, 2.0), centre_n=(2.0, 1.0, -1.0), colour="#ff8000"
    ),
    Obstacle(name="lamp", shape="sphere", size_m=(0.5, 0.5, 0.5), centre_n=(0.0, 1.0, -2.0)),
)
GENERIC_RPY = (np.radians(10.0), np.radians(-20.0), np.radians(35.0))
NAN = math.nan
Q_NB = tuple(quat_from_euler(np.array(GENERIC_RPY)).tolist())


class ViewerRecord:
    """Channels for viewers that are recorded in memory. time_s, in `messages`: log time [s]."""

    def __init__(self, *vehicles: ViewedVehicle) -> None:
        self._definitions = Definitions()
        self._buffer = MessageBuffer(self._definitions.define)
        self._made: list[MessageChannel] = []
        self.channels = FoxgloveChannels(
            vehicles or (UAV1,), self._channel, size_m=SIZE_M, fence=FENCE, obstacles=OBSTACLES
        )

    def _channel(self, topic: str, encoding: str, schema: SchemaData) -> Log:
        self._made.append(MessageChannel(self._buffer, self._definitions.add(topic, encoding, schema)))
        return self._made[-1].log

    @cached_property
    def data(self) -> bytes:
        """Return the MCAP file. Messages that are recorded after the first call are not in it."""
        file = IndexedFile(self._definitions)
        return file.begin("test", {}) + file.chunk(*self._buffer.take()) + file.end(self._made)

    def messages(self) -> dict[str, list[tuple[float, Any]]]:
        """Return (time_s, decoded message) of each message, by topic."""
        return decoded(self.data)


def decoded(data: bytes) -> dict[str, list[tuple[float, Any]]]:
    """Return (log time [s], decoded message) of each Protobuf and CDR message in an MCAP file, by topic."""
    reader = make_reader(io.BytesIO(data), decoder_factories=[ProtobufDecoder(), Ros2Decoder()])
    summary = reader.get_summary()
    assert summary is not None
    topics = [c.topic for c in summary.channels.values() if c.message_encoding in ("protobuf", "cdr")]
    found = defaultdict(list)
    for _, channel, message, value in reader.iter_decoded_messages(topics=topics):
        found[channel.topic].append((message.log_time * 1e-9, value))
    return dict(found)


def frame(number: int, exposed_s: float, *poses: Pose) -> CapturedFrame:
    return CapturedFrame(number=number, time_s=exposed_s, poses=poses, untracked=(), sent_s=None)


def truth(p_n: tuple[float, float, float], q_nb: tuple[float, ...], time_s: float) -> Truth:
    """Return the true state of one vehicle at rest."""
    zero = np.zeros((1, 3))
    return Truth(
        time_s=time_s,
        p_n=np.array([p_n]),
        q_nb=np.array([q_nb]),
        v_n=zero,
        omega_b=zero,
        accel_b=zero,
        motors=np.zeros((1, 4)),
    )


def sender(component: int = 1) -> mavlink.MAVLink:
    return mavlink.MAVLink(None, srcSystem=1, srcComponent=component)


def sent(
    record: ViewerRecord, message: mavlink.MAVLink_message, time_s: float = 1.0, component: int = 1
) -> None:
    record.channels.on_datagrams([("uav1", component != 1, message.pack(sender(component)), time_s)])


def position(p_n: tuple[float, ...]) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_local_position_ned_message(0, *p_n, 0.1, 0.2, 0.3)


def attitude(q_nb: tuple[float, ...]) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_quaternion_message(0, *q_nb, 0.4, 0.5, 0.6)


def reference(x: float, yaw: float = NAN) -> mavlink.MAVLink_message:
    mask = 0b111000 | (1 << 10 if math.isnan(yaw) else 0)  # without velocity
    return mavlink.MAVLink_position_target_local_ned_message(0, 1, mask, x, 2, -1, 7, 7, 7, 0, 0, 0, yaw, 0)


def full_flight() -> ViewerRecord:
    """Return a record with all kinds of input over 12 s."""
    record = ViewerRecord()
    for k in range(360):
        t = k / 30
        pos = np.array([0.1 * t, 0.0, -1.0])
        record.channels.on_datagrams(
            [("uav1", False, stream(t, pos, (0.1 * t, 0.0, -1.0), OFFBOARD, True, False), t)]
        )
        for sub in range(6):
            number = 6 * k + sub
            record.channels.on_frame(frame(number, t, Pose("body1", tuple(pos), Q_NB)), True, t + sub / 180)
        record.channels.on_truth(truth(tuple(pos), Q_NB, t), t)
    sent(record, mavlink.MAVLink_servo_output_raw_message(0, 0, 1500, 2000, 1000, 1250, 0, 0, 0, 0), 12.0)
    sent(
        record,
        mavlink.MAVLink_estimator_status_message(0, 831, 0.1, 0.2, 0.3, 0.4, NAN, NAN, 0.01, 0.02),
        12.0,
    )
    sent(record, mavlink.MAVLink_wind_cov_message(0, 1.0, -2.0, 0.0, 0, 0, 0, 0, 0), 12.0)
    sent(record, reference(1.5), 12.0, component=191)
    record.channels.on_event(b"", {"process": "world", "event": "fault: wind 3 0 0 m/s"}, 12.0)
    return record
