"""Tests of the playback: which message is sent at which time."""

from __future__ import annotations

import itertools
import math

import pytest

from arena.replay.playback import MAX_DELAY_S, STEP_NS, Playback, Step
from arena.replay.script import NS, Item
from tests.replay.scripts import MS, ListScript, down, heartbeat, position

SCRIPT = ListScript(
    messages=[down(1000, heartbeat()), *(down(1000 + 7 * k, position(1, k)) for k in range(1, 101))]
)


def play(playback: Playback, steps: int = 10_000, wall: float = 0.0) -> list[Step]:
    made = []
    while not playback.finished and len(made) < steps:
        made.append(playback.step(wall))
    return made


def sent(steps: list[Step]) -> list[Item]:
    return [item for step in steps for item in step.items]


def test_time_before_the_start_does_not_count() -> None:
    playback = Playback(ListScript(messages=[down(0, b"a"), down(3, b"b")]), wall=10.0)
    playback.start(10.2)
    playback.step(10.2)
    assert playback.wait_s(10.2) == pytest.approx(0.003)


def test_every_message_is_sent_once_at_its_time() -> None:
    steps = play(Playback(SCRIPT, wall=0.0, speed=math.inf))
    assert sent(steps) == list(SCRIPT.messages)
    assert all(item.time_ns == step.clock_ns for step in steps for item in step.items)


def test_clock_advances_in_small_steps_between_messages() -> None:
    steps = play(Playback(SCRIPT, wall=0.0))
    clocks = [step.clock_ns for step in steps]
    assert clocks[0] == 1000 * MS
    assert all(0 < b - a <= STEP_NS for a, b in itertools.pairwise(clocks))


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_messages_wait_for_their_time_at_the_speed(speed: float) -> None:
    playback = Playback(SCRIPT, wall=10.0, speed=speed)
    wall = 10.0
    while not playback.finished:
        wall += max(0.0, playback.wait_s(wall))
        step = playback.step(wall)
        assert wall - 10.0 == pytest.approx((step.record_ns - SCRIPT.start_ns) / NS / speed, abs=1e-9)


def test_lost_time_after_a_stall_is_not_made_up() -> None:
    playback = Playback(SCRIPT, wall=0.0)
    playback.step(0.0)
    assert playback.wait_s(5.0) == 0.0
    playback.step(5.0)
    assert playback.wait_s(5.0) > 0.0


def test_short_delay_is_made_up() -> None:
    playback = Playback(SCRIPT, wall=0.0)
    playback.step(0.0)
    wall = 0.5 * MAX_DELAY_S
    while playback.wait_s(wall) <= 0.0:
        playback.step(wall)
    assert playback.record_ns - SCRIPT.start_ns == pytest.approx(wall * NS, abs=STEP_NS)


def test_paused_replay_waits_and_continues_at_the_same_place() -> None:
    playback = Playback(SCRIPT, wall=0.0, paused=True)
    assert playback.wait_s(3.0) == math.inf
    playback.pause(False, 7.0)
    assert playback.wait_s(7.0) <= 0.0
    assert playback.step(7.0).clock_ns == SCRIPT.start_ns


def test_start_in_the_middle_sends_the_state_messages_first() -> None:
    playback = Playback(SCRIPT, wall=0.0, start_ns=1350 * MS, speed=math.inf)
    steps = play(playback)
    first = steps[0]
    assert first.clock_ns == 1350 * MS
    assert [i.payload for i in first.items[:2]] == [heartbeat(), position(1, 49)]
    assert sent(steps)[2:] == [i for i in SCRIPT.messages if i.time_ns >= 1350 * MS]


def test_jump_back_keeps_the_clock_increasing_and_sends_the_messages_again() -> None:
    playback = Playback(SCRIPT, wall=0.0, speed=math.inf)
    before = play(playback, steps=100)
    playback.seek(1100 * MS, 0.0)
    after = play(playback)
    clocks = [step.clock_ns for step in before + after]
    assert clocks == sorted(clocks)
    assert after[0].jumped
    assert not after[1].jumped
    assert after[0].record_ns == 1100 * MS
    assert sent(after)[2:] == [i for i in SCRIPT.messages if i.time_ns >= 1100 * MS]


def test_place_after_a_jump_is_shown_while_paused() -> None:
    playback = Playback(SCRIPT, wall=0.0, paused=True)
    playback.seek(1351 * MS, 0.0)
    assert playback.wait_s(0.0) == 0.0
    step = playback.step(0.0)
    assert step.record_ns == 1351 * MS
    assert [item.payload for item in step.items] == [heartbeat(), position(1, 50)]
    assert playback.wait_s(0.0) == math.inf


def test_jump_outside_the_record_ends_at_its_border() -> None:
    playback = Playback(SCRIPT, wall=0.0)
    playback.seek(0, 0.0)
    assert playback.record_ns == SCRIPT.start_ns
    playback.seek(10**15, 0.0)
    assert playback.record_ns == SCRIPT.end_ns


def test_loop_begins_again_at_the_end() -> None:
    playback = Playback(SCRIPT, wall=0.0, speed=math.inf, loop=True)
    steps = play(playback, steps=600)
    assert not playback.finished
    count = len(SCRIPT.messages)
    assert sent(steps)[count : 2 * count] == list(SCRIPT.messages)


def test_message_with_an_earlier_time_is_sent_at_once() -> None:
    script = ListScript(
        messages=[down(1000, heartbeat()), down(1010, b"a"), down(1008, b"b"), down(1012, b"c")]
    )
    steps = play(Playback(script, wall=0.0, speed=math.inf))
    assert [item.payload for item in sent(steps)][1:] == [b"a", b"b", b"c"]
    clocks = [step.clock_ns for step in steps]
    assert clocks == sorted(clocks)


def test_speed_changes_without_a_jump_of_the_place() -> None:
    playback = Playback(SCRIPT, wall=0.0)
    play(playback, steps=5)
    place = playback.record_ns
    playback.set_speed(2.0, 100.0)
    assert playback.record_ns == place
    assert playback.wait_s(100.0) == pytest.approx((playback.step(100.0).record_ns - place) / NS / 2.0)
