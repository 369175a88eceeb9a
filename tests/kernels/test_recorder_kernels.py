"""Messages for viewers and for the record, encoded by the compiled and by the interpreted kernels."""

from __future__ import annotations

import math
import random
import struct
from types import ModuleType
from typing import Any

import pytest
from foxglove.messages import FrameTransform, Pose, PoseInFrame, Quaternion, Timestamp, Vector3
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.mavlink_frame import SEEDS, TRIES
from arena.wire.mavlink_layout import layout, payload_bytes
from arena.wire.mavlink_targets import TARGETS
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAMES = ("viewer_meters", "viewer_messages", "viewer_telemetry", "record_messages", "mavlink_framing")
INTERPRETED, COMPILED = interpreted_modules(*NAMES), compiled_modules(*NAMES)
VERSIONS = [
    pytest.param(INTERPRETED, id="interpreted"),
    pytest.param(COMPILED, id="compiled", marks=needs_compiled),
]
TOPICS = {
    "local_position": 6,
    "attitude": 10,
    "position_setpoint": 7,
    "program_reference": 7,
    "attitude_setpoint": 11,
    "actuators": 8,
    "imu": 12,
}
NUMBERS = {
    "LOCAL_POSITION_NED": 6,
    "ATTITUDE_QUATERNION": 7,
    "POSITION_TARGET_LOCAL_NED": 8,
    "ATTITUDE_TARGET": 8,
    "SERVO_OUTPUT_RAW": 8,
    "ACTUATOR_CONTROL_TARGET": 8,
    "HIGHRES_IMU": 12,
}


def number(rng: random.Random) -> float:
    return rng.choice([0.0, -0.0, 1e-310, rng.gauss(0, 1), rng.gauss(0, 1e6)])


@pytest.mark.parametrize("modules", VERSIONS)
@pytest.mark.parametrize("child", ["uav1/truth", "v" * 300])
def test_poses_are_encoded_as_by_foxglove(modules: dict[str, ModuleType], child: str) -> None:
    rng, kernel = random.Random(1), modules["viewer_messages"]
    messages = kernel.PoseMessages("arena", child)
    for log_time in (0, 5, 999_999_999, 1_000_000_000, 1_764_221_234_123_456_789):
        for _ in range(30):
            p_n, q_nb = tuple(number(rng) for _ in range(3)), tuple(number(rng) for _ in range(4))
            messages.set(p_n, q_nb, log_time)
            (x, y, z), (w, *v) = kernel.arena_position(p_n), kernel.arena_attitude(q_nb)
            place, turn = Vector3(x=x, y=y, z=z), Quaternion(x=v[0], y=v[1], z=v[2], w=w)
            stamp = Timestamp(*divmod(log_time, 1_000_000_000))
            pose = PoseInFrame(timestamp=stamp, frame_id="arena", pose=Pose(position=place, orientation=turn))
            transform = FrameTransform(
                timestamp=stamp,
                parent_frame_id="arena",
                child_frame_id=child,
                translation=place,
                rotation=turn,
            )
            assert messages.pose() == pose.encode()
            assert messages.transform() == transform.encode()


@pytest.mark.parametrize("modules", VERSIONS)
def test_numbers_are_a_message_of_float32(modules: dict[str, ModuleType]) -> None:
    messages = modules["viewer_messages"].NumberMessages(3)
    assert messages.pack((1.5, math.inf, 7)) == b"\0\1\0\0" + struct.pack("<3f", 1.5, math.inf, 7.0)
    with pytest.raises(ValueError, match="got 2 values, expected 3"):
        messages.pack((1.0, 2.0))


@pytest.mark.parametrize("modules", VERSIONS)
def test_log_time_is_rounded_to_the_nearest_nanosecond(modules: dict[str, ModuleType]) -> None:
    rng, kernel = random.Random(2), modules["viewer_meters"]
    times = [0.5e-9, 1.5e-9, 2.5e-9, 0.0, -3.0, 1.7e9 + 0.123456789]
    for time_s in times + [rng.uniform(0, 10 ** rng.uniform(-9, 9)) for _ in range(2000)]:
        assert kernel.nanoseconds(time_s) == max(0, round(1e9 * time_s))
    for time_s in (math.nan, math.inf, 1e10):
        with pytest.raises(ValueError, match="log time"):
            kernel.nanoseconds(time_s)


def fields_of(number: int, count: int, codes: str) -> list[tuple[int, int]]:
    """Return the types and places of the last numbers of a message."""
    found = [
        (codes.index(field.code), field.offset // struct.calcsize(f"<{field.code}") + k)
        for field in layout(number).values()
        for k in range(field.elements)
    ]
    return found[-count:]


class Recorded:
    """Converter of one vehicle, and the calls that it makes, as text because a NaN differs from itself."""

    def __init__(self, modules: dict[str, ModuleType]) -> None:
        kernel, limit = modules["viewer_telemetry"], modules["viewer_meters"].Throttle
        self.calls: list[str] = []
        ids = [getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in kernel.FREQUENT]
        readers = [
            kernel.PayloadReader(n, payload_bytes(n), fields_of(n, NUMBERS[name], kernel.KINDS))
            for n, name in zip(ids, kernel.FREQUENT, strict=True)
        ]
        numbers = {
            topic: kernel.NumberOutput(limit(1 / 15), self.log(topic), count)
            for topic, count in TOPICS.items()
        }
        poses = {
            topic: kernel.PoseOutput(limit(1 / 15), self.log(topic), self.log("tf"), "arena", "uav1")
            for topic in ("estimate/pose", "setpoint/pose")
        }
        self.converter = kernel.ViewerTelemetry(
            (1, 1),
            modules["mavlink_framing"].FrameParser(SEEDS, TARGETS, TRIES),
            readers,
            numbers,
            poses,
            [0, 1, 253],
            lambda data, fields, time_s: self.calls.append(repr((data, tuple(fields), time_s))),
            lambda pressure: 100.0 * pressure,
            [85],
            lambda data, time_s: self.calls.append(f"up {data.hex()} {time_s}"),
        )

    def log(self, topic: str) -> Any:
        return lambda data, log_time: self.calls.append(f"{topic} {data.hex()} {log_time}")


def messages(rng: random.Random) -> list[bytes]:
    """Return frames of all messages that are published, of the vehicle and of other senders."""

    def values(count: int) -> list[float]:
        return [rng.choice([0.0, math.nan, rng.gauss(0, 1)]) for _ in range(count)]

    made = [
        mavlink.MAVLink_local_position_ned_message(0, *values(6)),
        mavlink.MAVLink_attitude_quaternion_message(0, *values(7)),
        mavlink.MAVLink_position_target_local_ned_message(0, 1, rng.randrange(1 << 16), *values(11)),
        mavlink.MAVLink_attitude_target_message(0, 0, values(4), *values(4)),
        mavlink.MAVLink_servo_output_raw_message(0, 0, *[rng.choice([0, 900, 1500, 2100])] * 16),
        mavlink.MAVLink_actuator_control_target_message(0, 0, values(8)),
        mavlink.MAVLink_highres_imu_message(0, *values(13), 0),
        mavlink.MAVLink_heartbeat_message(2, 12, 129, 6 << 16, 4, 3),
        mavlink.MAVLink_statustext_message(6, b"text"),
        mavlink.MAVLink_attitude_message(0, *values(6)),
        mavlink.MAVLink_wheel_distance_message(0, 1, [1.0] * 16),
    ]
    sender = mavlink.MAVLink(
        None, srcSystem=rng.choice([0, 1, 1, 1, 1, 2]), srcComponent=rng.choice([1, 1, 1, 191])
    )
    sender.seq = rng.randrange(256)
    if rng.random() < 0.1:
        sender.signing.secret_key, sender.signing.sign_outgoing = bytes(32), True
    return [
        bytes(m.pack(sender, force_mavlink1=m.get_msgId() < 256 and rng.random() < 0.05))
        for m in rng.sample(made, rng.randrange(1, 6))
    ]


def datagram(rng: random.Random) -> bytes:
    """Return a datagram: sometimes with a wrong byte, cut, or with garbage around it."""
    data = b"".join(messages(rng))
    kind = rng.randrange(12)
    if kind == 0:
        wrong = bytearray(data)
        wrong[rng.randrange(len(wrong))] ^= 1 << rng.randrange(8)
        return bytes(wrong)
    if kind == 1:
        return data[rng.randrange(len(data)) :] + rng.randbytes(rng.randrange(5))
    return data[: rng.randrange(len(data))] if kind == 2 else data


@needs_compiled
def test_compiled_and_interpreted_converter_publish_the_same() -> None:
    rng, both = random.Random(3), [Recorded(INTERPRETED), Recorded(COMPILED)]
    for k in range(3000):
        data, time_s = datagram(rng), 0.02 * k if k % 500 else 0.0
        for each in both:
            each.converter.on_datagram(data, time_s)
            each.converter.on_datagram_up(data, time_s)
        assert both[0].calls == both[1].calls, data.hex()
    assert len(both[0].calls) > 2000
    assert both[0].converter.traffic.take(1.0) == both[1].converter.traffic.take(1.0)
    assert both[0].converter.flown.take() == both[1].converter.flown.take()


@pytest.mark.parametrize("modules", VERSIONS)
def test_setpoint_of_a_program_is_counted_only(modules: dict[str, ModuleType]) -> None:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, *[1.0] * 11).pack(sender)
    wanted = mavlink.MAVLink_position_target_local_ned_message(0, 1, 0, *[1.0] * 11).pack(sender)
    recorded = Recorded(modules)
    for data in (setpoint, wanted, setpoint + wanted):
        recorded.converter.on_datagram_up(bytes(data), 1.0)
    assert recorded.calls == [f"up {bytes(data).hex()} 1.0" for data in (wanted, setpoint + wanted)]
    assert recorded.converter.traffic.take(1.0)[1] == 3


@pytest.mark.parametrize("modules", VERSIONS)
def test_frame_with_a_wrong_crc_is_not_published(modules: dict[str, ModuleType]) -> None:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    good = mavlink.MAVLink_local_position_ned_message(0, *[1.0] * 6).pack(sender)
    wrong = bytearray(mavlink.MAVLink_attitude_quaternion_message(0, *[1.0] * 7).pack(sender))
    wrong[-1] ^= 1
    recorded = Recorded(modules)
    recorded.converter.on_datagram(bytes(good) + bytes(wrong), 1.0)
    recorded.converter.on_datagram(bytes(wrong), 2.0)
    assert [call.split()[0] for call in recorded.calls] == ["local_position"]


@needs_compiled
def test_compiled_and_interpreted_messages_of_the_record_are_the_same() -> None:
    rng = random.Random(4)
    for _ in range(50):
        names = [f"b{rng.randrange(100)}" * rng.randrange(1, 4) for _ in range(rng.randrange(6))]
        tracked = rng.randrange(len(names) + 1)
        poses = [(n, tuple(rng.random() for _ in "xyz"), tuple(rng.random() for _ in "wxyz")) for n in names]
        found = {
            m["record_messages"].FrameMessages(names, tracked).pack(7, 0.5, math.nan, True, poses[:tracked])
            for m in (INTERPRETED, COMPILED)
        }
        assert len(found) == 1
    state = ((1, 2, 3), [4.0, 5.0, 6.0], (7, 8, 9, 10), (11, 12, 13))
    assert len({m["record_messages"].StateMessages().pack(*state) for m in (INTERPRETED, COMPILED)}) == 1


@pytest.mark.parametrize("modules", VERSIONS)
def test_counter_finds_datagrams_with_the_state_of_the_autopilot(modules: dict[str, ModuleType]) -> None:
    counter = modules["viewer_meters"].DatagramCounter(
        mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    )
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3).pack(codec)
    attitude = mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(codec)
    assert math.isnan(counter.first_s)
    assert not counter.count(True, heartbeat, 1.0) and math.isnan(counter.first_s)
    assert not counter.count(False, attitude, 2.0)
    assert counter.count(False, attitude + heartbeat, 3.0)
    assert (counter.down, counter.up, counter.first_s) == (2, 1, 2.0)
