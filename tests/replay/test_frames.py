"""Tests of the recorded motion-capture frames on their way to server and recorder."""

from __future__ import annotations

import math

import pytest

from arena.fused.captured_frames import FrameConverter as ClientConverter
from arena.geometry import q_wf_from_q_nb, quat_from_euler, xyzw_from_wxyz
from arena.replay.frames import FrameConverter, captured, sent_s
from arena.wire.flight_record import RecordedBody, RecordedFrame

NAN3, NAN4 = (math.nan,) * 3, (math.nan,) * 4
Q_NB = tuple(quat_from_euler([0.17, -0.35, 0.61]).tolist())


def frame(number: int, *bodies: RecordedBody) -> RecordedFrame:
    return RecordedFrame(5.01, number, 5.0, 5.008, True, bodies)


def seen(name: str) -> RecordedBody:
    return RecordedBody(name, True, (1.0, -2.0, -3.0), Q_NB)  # type: ignore[arg-type]


def test_client_gets_the_recorded_poses() -> None:
    made = FrameConverter({"a": 1, "b": 2}).measured(
        frame(7, seen("a"), RecordedBody("b", False, NAN3, NAN4)), 0.0
    )
    received = ClientConverter([{"name": "a", "number": 1}, {"name": "b", "number": 2}]).convert(made, 5.01)
    assert received.number == 7
    assert received.time_s == 5.0
    (pose,) = received.poses
    assert pose.p_n == (1.0, -2.0, -3.0)
    assert pose.q_nb == pytest.approx(Q_NB, abs=1e-15)
    assert received.untracked == ("b",)


def test_client_compares_the_clocks_five_times_a_second_and_after_a_jump_back() -> None:
    measured = FrameConverter({"a": 1}).measured(frame(7, seen("a")), 0.0)
    converter = ClientConverter([{"name": "a", "number": 1}])
    echoes = [converter.convert(measured, t).echo for t in (5.0, 5.1, 5.19, 5.21, 5.3, 2.0)]
    assert [echo.answered_s for echo in echoes] == [5.0, 5.0, 5.0, 5.21, 5.21, 2.0]
    assert all(echo.sent == echo.received == echo.answered_s for echo in echoes)


def test_recorder_gets_the_frame_unchanged() -> None:
    made = captured(frame(7, seen("a"), RecordedBody("b", False, NAN3, NAN4)), 0.0)
    assert (made.number, made.time_s, made.sent_s) == (7, 5.0, 5.008)
    assert [(p.body, p.p_n, p.q_nb) for p in made.poses] == [("a", (1.0, -2.0, -3.0), Q_NB)]
    assert made.untracked == ("b",)


def test_times_move_with_the_clock_after_a_jump() -> None:
    made = FrameConverter({"a": 1}).measured(frame(7, seen("a")), 30.0)
    assert made.exposed_s == 35.0
    assert sent_s(frame(7), 30.0) == 35.008
    assert sent_s(frame(7)._replace(sent_s=math.nan), 30.0) == 35.0


def test_frame_numbers_increase_after_a_jump_back() -> None:
    converter = FrameConverter({})
    numbers = [converter.measured(frame(k), 0.0).number for k in (100, 101, 105)]
    numbers.append(converter.measured(frame(20), 0.0, jumped=True).number)
    numbers += [converter.measured(frame(k), 0.0).number for k in (21, 24)]
    assert numbers == [100, 101, 105, 106, 107, 110]


def test_quaternion_in_capture_axes_is_that_of_the_geometry_package() -> None:
    made = FrameConverter({"a": 1}).measured(frame(1, seen("a")), 0.0).bodies[0]
    expected = xyzw_from_wxyz(q_wf_from_q_nb(Q_NB))
    assert made.position_w == (-2.0, 1.0, 3.0)
    assert abs(float(expected @ made.quat_xyzw_wf)) == pytest.approx(1.0, abs=1e-12)
