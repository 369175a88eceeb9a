"""Tests of the check that a replay can reach this computer only."""

from __future__ import annotations

from typing import Any

import pytest

from arena.errors import InputError
from arena.replay.loopback import check_loopback

GOOD = {"router": {"gcs_local": ["127.0.77.1", 24000]}, "mocap": {"group": "239.192.77.1", "version": "3.1"}}


def test_loopback_and_multicast_are_allowed() -> None:
    check_loopback(GOOD)


@pytest.mark.parametrize(
    "bad",
    [
        {"router": {"gcs": [{"address": ["192.168.1.20", 14550]}]}},
        {"router": {"gcs_local": ["0.0.0.0", 24000]}},
        {"link.uav1": {"wire": {"kind": "serial"}}},
        {"link.uav1": {"settings": {"device": "/dev/ttyUSB0"}}},
    ],
)
def test_other_computers_and_connections_to_vehicles_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"a replay (can use only|must not connect)"):
        check_loopback({**GOOD, **bad})


def test_ground_station_that_the_user_names_is_allowed() -> None:
    check_loopback({"router": {"gcs": [["192.168.1.20", 14550]]}}, ["192.168.1.20"])
