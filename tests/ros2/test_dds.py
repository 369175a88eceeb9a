"""Readers of the DDS participant, with Cyclone DDS on the loopback network."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

import pytest

from arena.ros2.dds import Participant

pytest.importorskip("cyclonedds")
LIMIT_S = 60.0


@pytest.fixture
def participant(monkeypatch: pytest.MonkeyPatch) -> Iterator[Participant]:
    monkeypatch.setenv("CYCLONEDDS_URI", "")
    monkeypatch.delenv("CYCLONEDDS_URI")
    yield Participant(100 + os.getpid() % 100, "127.0.0.1")


def test_reader_returns_the_newest_messages_in_order(participant: Participant) -> None:
    write = participant.writer("/uav1/command", "std_msgs/String")
    all_of, newest_of = (participant.reader("/uav1/command", "std_msgs/String", depth=n) for n in (8, 1))
    until = time.monotonic() + LIMIT_S
    while not all_of():  # until writer and reader have found each other
        assert time.monotonic() < until
        write({"data": "first"})
        time.sleep(0.01)
    while not newest_of():
        assert time.monotonic() < until
        write({"data": "first"})
        time.sleep(0.01)
    time.sleep(0.1)
    all_of()
    newest_of()
    for data in ("offboard", "arm", "land"):
        write({"data": data})
    found: list[str] = []
    while len(found) < 3:
        assert time.monotonic() < until
        found += [sample.message["data"] for sample in all_of()]
    assert found == ["offboard", "arm", "land"]
    assert [sample.message["data"] for sample in newest_of()] == ["land"]
    assert newest_of() == []
