"""Tests of the request that changes a running replay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from arena.supervisor.replay_request import replay_packet

from .conftest import plan_of, spec, vehicle, world

REPLAY = replace(
    plan_of(spec("replay", "sleeps", kind="replay"), vehicles=(vehicle(),)), replay="/a/flight.mcap"
)


def test_given_keys_are_sent_to_the_replay() -> None:
    request = {"do": "replay", "pause": True, "seek_s": 12.5, "speed": "max", "other": 1}
    names, packet = replay_packet(REPLAY, request)
    assert names == ["replay"]
    assert packet == {"do": "replay", "pause": True, "seek_s": 12.5, "speed": "max"}
    assert replay_packet(REPLAY, {"do": "replay", "seek_s": 3})[1] == {"do": "replay", "seek_s": 3}


@pytest.mark.parametrize(
    "request_",
    [
        {},
        {"pause": 1},
        {"seek_s": "2"},
        {"seek_s": float("nan")},
        {"speed": 0},
        {"speed": "fast"},
        {"speed": True},
    ],
)
def test_wrong_request_is_refused(request_: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        replay_packet(REPLAY, request_)


def test_flight_cannot_be_paused() -> None:
    with pytest.raises(ValueError, match="is not a replay"):
        replay_packet(plan_of(world(), vehicles=(vehicle(),)), {"pause": True})
