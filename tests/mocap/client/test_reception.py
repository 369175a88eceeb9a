"""Record of what a client has received recently, and the report of its diagnosis."""

from __future__ import annotations

from collections import Counter

from arena.mocap.client.diagnosis import RECOVERED, ChangeReport
from arena.mocap.client.pose import CapturedFrame, Pose
from arena.mocap.client.reception import Reception

POSE = Pose("uav1", (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0))


def test_each_diagnosis_is_reported_once_and_so_is_its_end():
    report = ChangeReport()
    changes = [report.changed(d) for d in ("", "a", "a", "b", "", "")]
    assert changes == [None, "a", None, "b", RECOVERED, None]


def test_body_is_hidden_after_two_seconds_without_a_pose():
    reception, served = Reception(0.0), Counter(["uav1"])
    frames = 0

    def hidden(now: float, *, tracked: bool) -> list[str]:
        nonlocal frames
        frames += 1
        frame = CapturedFrame(frames, now, (POSE,) if tracked else (), () if tracked else ("uav1",))
        assert reception.update_frames(frames, [frame], now)
        return list(reception.body_status(served, ["uav1"], now).hidden)

    assert [hidden(t, tracked=False) for t in (0.1, 1.0, 2.0)] == [[], [], []]
    assert hidden(2.2, tracked=False) == ["uav1"]
    assert hidden(2.3, tracked=True) == []
    assert hidden(3.0, tracked=False) == []


def test_first_foreign_address_is_kept_until_it_is_silent():
    reception = Reception(0.0)
    reception.on_foreign("10.0.0.6", 1.0)
    reception.on_foreign("10.0.0.7", 2.0)
    assert reception.foreign_address(5.0) == "10.0.0.6"
    reception.on_foreign("10.0.0.7", 7.0)
    assert (reception.foreign_address(7.0), reception.foreign_address(13.0)) == ("10.0.0.7", "")


def test_event_is_recent_only_after_its_count_has_changed():
    reception = Reception(0.0)
    assert not reception.update("answers", 0, 1.0) and not reception.recent("answers", 1.0)
    assert reception.update("answers", 1, 2.0) and reception.recent("answers", 6.9)
    assert not reception.update("answers", 1, 6.0) and not reception.recent("answers", 7.0)
