"""HIL_ACTUATOR_CONTROLS read by the compiled and by the interpreted kernel, against pymavlink."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.wire.hil import HIL_ACTUATOR_CONTROLS
from arena.wire.mavlink_frame import PARSER, SEEDS
from arena.wire.mavlink_targets import TARGETS
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAMES = ("motor_replies", "mavlink_framing")
INTERPRETED = interpreted_modules(*NAMES)
VERSIONS = [
    pytest.param(INTERPRETED, id="interpreted"),
    pytest.param(compiled_modules(*NAMES), id="compiled", marks=needs_compiled),
]
LOCKSTEP, ARMED = 1, 128
times = st.integers(0, 2**64 - 1)


def reader(modules: dict[str, ModuleType], rotors: int = 4) -> Any:
    parser = modules["mavlink_framing"].FrameParser(SEEDS, TARGETS, 32)
    motors = memoryview(np.zeros(rotors))
    return modules["motor_replies"].MotorReplies(parser, HIL_ACTUATOR_CONTROLS, motors)


def reply(
    time_usec: int = 0, outputs: tuple[float, ...] = (), mode: int = ARMED, flags: int = LOCKSTEP
) -> bytes:
    controls = [*outputs, *[0.0] * (16 - len(outputs))]
    message = mavlink.MAVLink_hil_actuator_controls_message(time_usec, controls, mode, flags)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))


def motors(found: Any) -> list[float]:
    return np.asarray(found.motors).tolist()


@pytest.mark.parametrize("modules", VERSIONS)
@given(times, st.lists(st.floats(width=32), min_size=16, max_size=16), st.integers(0, 255), times)
def test_a_reply_is_read_as_the_other_codec_packs_it(
    modules: dict[str, ModuleType], time_usec: int, outputs: list[float], mode: int, flags: int
) -> None:
    found = reader(modules, 16)
    assert found.read(reply(time_usec, tuple(outputs), mode, flags))
    assert (found.time_usec, found.armed, found.lockstep) == (time_usec, bool(mode & 128), bool(flags & 1))
    limited = [min(max(x, 0.0), 1.0) if math.isfinite(x) and mode & 128 else 0.0 for x in outputs]
    assert motors(found) == limited


@pytest.mark.parametrize("modules", VERSIONS)
def test_a_reply_of_one_byte_is_all_zeros(modules: dict[str, ModuleType]) -> None:
    found, data = reader(modules), reply(mode=0, flags=0)
    assert data[1] == 1 and found.read(reply(5, (0.5,) * 4)) and found.read(data)
    assert (found.time_usec, found.armed, found.lockstep, motors(found)) == (0, False, False, [0.0] * 4)


@pytest.mark.parametrize("modules", VERSIONS)
def test_only_one_whole_reply_is_read_at_once(modules: dict[str, ModuleType]) -> None:
    found, data = reader(modules), reply(7, (0.25,) * 4)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3).pack(mavlink.MAVLink(None))
    broken = data[:20] + bytes([data[20] ^ 1]) + data[21:]
    for other in (b"", data[:-1], data + data, data + b"\0", b"\0" + data, bytes(heartbeat), broken, b"\xfd"):
        assert not found.read(other)
    assert (found.time_usec, found.armed, motors(found)) == (0, False, [0.0] * 4)
    assert found.read(data) and motors(found) == [0.25] * 4


def test_the_parser_of_the_process_fits_the_reader() -> None:
    found = compiled_modules("motor_replies")["motor_replies"]
    assert found.MotorReplies(PARSER, HIL_ACTUATOR_CONTROLS, memoryview(np.zeros(4))).read(reply())
