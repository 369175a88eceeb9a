"""The newest frame of each kind of telemetry, found by the compiled and by the interpreted kernel, compared with a plain search."""

from __future__ import annotations

import random
from types import ModuleType
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.kernels.mavlink_frame_types import Frame
from arena.wire.mavlink_frame import SEEDS, TARGETS, TRIES, parse_frames
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAMES = ("mavlink_framing", "newest_frames")
VERSIONS = [
    pytest.param(interpreted_modules(*NAMES), id="interpreted"),
    pytest.param(compiled_modules(*NAMES), id="compiled", marks=needs_compiled),
]
IMU, SERVOS, CONTROLS, HEARTBEAT, POSITION = 105, 36, 140, 0, 32
SLOTS = {POSITION: POSITION, IMU: IMU, SERVOS: SERVOS, CONTROLS: SERVOS}
WANTED = (*SLOTS, HEARTBEAT)
FIELDS_UPDATED, MASK = 60, 0x1BC0
Waiting = dict[int, dict[int, tuple[bytes, Frame, float]]]


def finder(modules: dict[str, ModuleType], waiting: Waiting) -> Any:
    parser = modules["mavlink_framing"].FrameParser(SEEDS, TARGETS, TRIES)
    return modules["newest_frames"].NewestFrames(
        parser, (1, 1), WANTED, SLOTS, (IMU, FIELDS_UPDATED, MASK), waiting
    )


def datagram(rng: random.Random) -> bytes:
    """Return a datagram with several messages: of the autopilot and others, signed, MAVLink 1, broken or unknown."""
    numbers = [rng.choice([0.0, 1.5, -2.0]) for _ in range(13)]
    made = [
        mavlink.MAVLink_local_position_ned_message(0, *numbers[:6]),
        mavlink.MAVLink_highres_imu_message(0, *numbers, rng.choice([0, 0x3F, 0x1FFF, 0x1C0])),
        mavlink.MAVLink_servo_output_raw_message(0, 0, *[1500] * 16),
        mavlink.MAVLink_actuator_control_target_message(0, 0, [0.5] * 8),
        mavlink.MAVLink_heartbeat_message(2, 12, 129, 6 << 16, 4, 3),
        mavlink.MAVLink_attitude_message(0, *numbers[:6]),
    ]
    data = b""
    for message in rng.choices(made, k=rng.randrange(12)):
        system, component = rng.choice([(1, 1)] * 6 + [(2, 1), (1, 191)])
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        if rng.random() < 0.05:
            sender.signing.secret_key, sender.signing.sign_outgoing = bytes(32), True
        old = message.get_msgId() < 256 and rng.random() < 0.03
        frame = bytearray(message.pack(sender, force_mavlink1=old))
        if rng.random() < 0.03:
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        data += bytes(frame) + rng.randbytes(rng.choice([0] * 60 + [1, 3]))
    return data[: rng.randrange(len(data) + 1)] if rng.random() < 0.03 else data


def plainly(data: bytes, now: float, waiting: Waiting) -> list[Frame] | None:
    """Do what `NewestFrames.receive` does, frame by frame."""
    frames = [f for f in parse_frames(data).frames if (f.sysid, f.compid) == (1, 1) and f.msgid in WANTED]
    for f in frames:
        if (slot := SLOTS.get(f.msgid)) is not None:
            field = data[f.payload : f.payload + f.size][FIELDS_UPDATED : FIELDS_UPDATED + 2]
            key = int.from_bytes(field, "little") & MASK if slot == IMU else 0
            of_slot = waiting.setdefault(slot, {})
            of_slot.pop(key, None)
            of_slot[key] = data, f, now
    return [f for f in frames if f.msgid not in SLOTS] if frames else None


@pytest.mark.parametrize("modules", VERSIONS)
def test_newest_frames_are_those_of_a_plain_search(modules: dict[str, ModuleType]) -> None:
    rng, expected, found = random.Random(8), {}, {}
    newest = finder(modules, found)
    rare = 0
    for k in range(3000):
        data = datagram(rng)
        wanted = plainly(data, 0.1 * k, expected)
        assert newest.receive(data, 0.1 * k) == wanted, data.hex()
        assert found == expected
        assert list(found.get(IMU, ())) == list(expected.get(IMU, ())), "order of arrival"
        rare += len(wanted or ())
        if rng.random() < 0.2:
            for slot in rng.sample(list(expected), len(expected) // 2):
                del expected[slot], found[slot]
    assert rare > 1000 and len(found[IMU]) > 1
