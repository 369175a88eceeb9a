"""Messages of the record: golden bytes, round trip, and an independent decoder of ROS 2 messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from arena.wire.flight_record import (
    CAPTURED_FRAME,
    TRUE_STATE,
    MessageSchema,
    pack_frame,
    pack_true_state,
    unpack_frame,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
poses = st.none() | st.tuples(*[finite] * 7)
bodies = st.dictionaries(st.text(st.characters(exclude_characters="\0", codec="utf-8")), poses, max_size=5)


def decoded(schema: MessageSchema, data: bytes) -> Any:
    """Return the message as the package mcap-ros2-support decodes it."""
    record = Schema(id=1, name=schema.name, encoding=schema.encoding, data=schema.text.encode())
    decode = DecoderFactory().decoder_for("cdr", record)
    assert decode is not None
    return decode(data)


def split(named: dict[str, tuple[float, ...] | None]) -> tuple[list[Any], list[str]]:
    """Return (name, p_n, q_nb) of the tracked bodies, and the names of the others."""
    poses = [(name, pose[:3], pose[3:]) for name, pose in named.items() if pose is not None]
    return poses, [name for name, pose in named.items() if pose is None]


def test_frame_has_these_bytes():
    assert pack_frame(7, 1.0, 2.0, True, [], ["a"])[:44] == (
        b"\x00\x01\x00\x00"  # CDR, little endian
        b"\x07\x00\x00\x00"  # number
        b"\x01\x00\x00\x00"  # simulated, gap
        b"\x00\x00\x00\x00\x00\x00\xf0\x3f"  # exposed_s
        b"\x00\x00\x00\x00\x00\x00\x00\x40"  # sent_s
        b"\x01\x00\x00\x00"  # number of bodies
        b"\x02\x00\x00\x00a\x00"  # name
        b"\x00"  # tracked
        b"\x00\x00\x00\x00\x00"  # gap
    )


@given(st.integers(0, 2**32 - 1), finite, finite, st.booleans(), bodies)
def test_frame_is_read_back_exactly(number, exposed_s, sent_s, simulated, named):
    made = sorted(named.items())
    found = unpack_frame(4.0, pack_frame(number, exposed_s, sent_s, simulated, *split(named)))
    assert found[:5] == (4.0, number, exposed_s, sent_s, simulated)
    assert [(body.name, body.tracked) for body in found.bodies] == [(n, pose is not None) for n, pose in made]
    for body, (_, pose) in zip(found.bodies, made, strict=True):
        assert (*body.p_n, *body.q_nb) == pose if pose is not None else all(map(math.isnan, body.p_n))


@given(bodies)
def test_ros_decoder_reads_the_same_frame(named):
    data = pack_frame(3, 0.25, math.nan, False, *split(named))
    other, own = decoded(CAPTURED_FRAME, data), unpack_frame(0.0, data)
    assert (other.number, other.simulated, other.exposed_s) == (3, False, 0.25)
    assert [body.name for body in other.bodies] == [body.name for body in own.bodies]
    np.testing.assert_array_equal([b.p_n for b in other.bodies], [b.p_n for b in own.bodies])
    np.testing.assert_array_equal([b.q_nb for b in other.bodies], [b.q_nb for b in own.bodies])


def test_ros_decoder_reads_a_true_state():
    found = decoded(TRUE_STATE, pack_true_state((1, 2, 3), (4, 5, 6), (7, 8, 9, 10), (11, 12, 13)))
    values = (*found.p_n, *found.v_n, *found.q_nb, *found.omega_b)
    assert values == tuple(range(1, 14))
