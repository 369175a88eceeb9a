"""The message about frames that arrive late."""

from __future__ import annotations

import math

from arena.mocap.client import LateFrames


def test_late_frames_are_reported_with_the_first_lateness():
    frames = LateFrames(0.1)
    assert frames.diagnosis(0.5) == "", "one late frame is no problem"
    text = frames.diagnosis(0.5)
    assert text.startswith("motion capture: frames arrive 0.50 s late (limit 0.1 s)")
    assert frames.diagnosis(0.7) == text
    assert frames.diagnosis(0.01) == ""


def test_stamps_that_cannot_be_right_are_not_reported_as_late():
    frames = LateFrames(0.1)
    assert [frames.diagnosis(math.inf) for _ in range(3)] == ["", "", ""]
