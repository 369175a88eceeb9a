"""Frames that arrive late: the copilot must not take their poses as fresh (review fault 15)."""

from __future__ import annotations

import pytest

from arena.mocap.client import CapturedFrame

from .scene import Scene


def delay_frames(scene: Scene, delay_s: float) -> None:
    """From now on, each frame was exposed `delay_s` before it arrives."""
    receive = scene.core.on_frames

    def late(frames: list[CapturedFrame], now: float) -> None:
        receive([frame._replace(time_s=frame.time_s - delay_s) for frame in frames], now)

    scene.core.on_frames = late  # type: ignore[method-assign, assignment]


@pytest.mark.parametrize("delay_s", [0.05, 0.15, 1.0])
def test_late_frames_give_late_tracks(delay_s: float) -> None:  # review fault 15
    scene = Scene()
    scene.run(5.0)
    assert scene.core.fleet_state(scene.now).pose_age[0] == pytest.approx(0.0, abs=0.001)
    delay_frames(scene, delay_s)
    scene.run(1.0)
    fleet = scene.core.fleet_state(scene.now)
    assert fleet.pose_age[0] == pytest.approx(delay_s, abs=0.001)
    assert bool(fleet.placed[0]) == (delay_s < 0.3)


def test_stops_are_predicted_with_the_lateness_of_the_frames() -> None:  # review fault 15
    scene = Scene()
    scene.run(5.0)
    prompt_s = scene.core.fleet_state(scene.now).stop.react_s[0]
    delay_frames(scene, 0.2)
    scene.run(1.0)
    assert scene.core.fleet_state(scene.now).stop.react_s[0] - prompt_s == pytest.approx(0.2, abs=0.001)


def test_late_frames_violate_the_rule_pose_age() -> None:  # review fault 15
    scene = Scene(section={"pose_age": {"do": "land"}})
    scene.run(5.0)
    assert scene.commands() == []
    delay_frames(scene, 3.0)
    scene.run(2.0)
    assert "AUTO.LAND" in scene.commands()
