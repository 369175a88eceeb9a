"""The barrier for programs that start together: common start time, missing programs, repeated use."""

from __future__ import annotations

import os
import threading

import pytest
from fake_autopilot import FakeAutopilot
from served import until

from arena.errors import InputError, NotConfirmedError
from arena.uav.start_barrier import START_DELAY_S, StartBarrier

from .conftest import make_uav

PROGRAMS = ["uav1", "uav2", "uav3"]


@pytest.fixture
def barriers(tmp_path):
    made = [StartBarrier(name, tmp_path / "barriers", PROGRAMS) for name in PROGRAMS]
    yield made
    for barrier in made:
        barrier.close()


def test_all_programs_get_the_same_start_time(barriers):
    waiting = []
    for k, barrier in enumerate(barriers):
        assert all(w.arrivals().start_s is None for w in waiting)
        waiting.append(barrier.arrive("start", 10.0 + k))
    assert {w.arrivals().start_s for w in waiting} == {12.0 + START_DELAY_S}


def test_barrier_may_be_for_some_of_the_programs(barriers):
    one, two = (b.arrive("pair", 5.0, 2) for b in barriers[:2])
    assert one.arrivals().start_s == two.arrivals().start_s == 5.0 + START_DELAY_S


def test_second_use_of_a_name_is_a_barrier_of_its_own(barriers):
    for barrier in barriers:
        barrier.arrive("lap", 1.0)
    again = [barrier.arrive("lap", 20.0) for barrier in barriers[:2]]
    assert all(w.arrivals().start_s is None for w in again)
    again.append(barriers[2].arrive("lap", 21.0))
    assert {w.arrivals().start_s for w in again} == {21.0 + START_DELAY_S}


def test_time_of_a_program_with_another_clock_is_ignored(tmp_path):
    sim, one, two = (
        StartBarrier(name, tmp_path, ["sim"] if name == "sim" else ["uav1", "uav2"])
        for name in ("sim", "uav1", "uav2")
    )
    sim.arrive("start", 12.0)
    real = one.arrive("start", 70000.0)
    assert real.arrivals().start_s is None
    two.arrive("start", 70010.0)
    assert real.arrivals().start_s == 70010.0 + START_DELAY_S


def test_withdrawn_program_starts_nobody(barriers):
    one, two = barriers[0].arrive("start", 1.0), barriers[1].arrive("start", 1.0)
    assert one.withdraw() == "2 of 3 programs have arrived (uav1, uav2; missing: uav3)"
    barriers[2].arrive("start", 40.0)
    assert two.arrivals().start_s is None


def test_arrival_of_an_ended_program_does_not_count(barriers):
    waiting = barriers[0].arrive("start", 1.0)
    barriers[1].arrive("start", 2.0)
    barriers[1].close()
    barriers[2].arrive("start", 3.0)
    assert waiting.arrivals().start_s is None


def test_programs_that_were_all_started_again_start_together(barriers, tmp_path):
    for barrier in barriers:
        barrier.arrive("start", 1.0)
        barrier.close()
    again = [StartBarrier(name, tmp_path / "barriers", PROGRAMS) for name in PROGRAMS]
    waiting = [again[0].arrive("start", 50.0), again[1].arrive("start", 51.0)]
    assert all(w.arrivals().start_s is None for w in waiting)
    waiting.append(again[2].arrive("start", 60.0))
    assert {w.arrivals().start_s for w in waiting} == {60.0 + START_DELAY_S}


def test_program_that_was_started_again_in_flight_does_not_start_alone(barriers, tmp_path):
    waiting = [barrier.arrive("start", 10.0 + 0.1 * k) for k, barrier in enumerate(barriers)]
    waiting[0].start(waiting[0].arrivals().start_s)
    assert waiting[1].arrivals().start_s == 10.2 + START_DELAY_S  # the first program has left already
    for one in waiting[1:]:
        one.start(10.2 + START_DELAY_S)
    barriers[0].close()
    alone = StartBarrier("uav1", tmp_path / "barriers", PROGRAMS).arrive("start", 20.0)
    assert alone.arrivals().start_s is None
    assert "missing: uav2, uav3" in alone.withdraw()


def test_cancelled_wait_starts_nobody(autopilot: FakeAutopilot, address, tmp_path):
    with make_uav(address, barriers=str(tmp_path), programs=["uav1", "uav2"]) as uav:
        steps = uav.steps.wait_for("start", None, 30.0)
        next(steps)
        other = StartBarrier("uav2", tmp_path, ["uav1", "uav2"]).arrive("start", uav.clock.now())
        assert other.arrivals().start_s is not None
        steps.close()
        assert other.arrivals().start_s is None


@pytest.mark.parametrize("count", [0, 4])
def test_impossible_number_of_programs_is_refused(barriers, count):
    with pytest.raises(InputError, match=f"got n={count}, expected 1 to 3"):
        barriers[0].arrive("start", 1.0, count)


def test_name_that_is_no_file_name_is_refused(barriers):
    with pytest.raises(InputError, match="letters, digits"):
        barriers[0].arrive("../start", 1.0)


def test_program_started_by_hand_has_no_barrier(autopilot, uav):
    with pytest.raises(InputError, match="needs a program that `arena up` started"):
        uav.wait_for("start", n=2)


def test_missing_program_is_named_after_the_timeout(autopilot: FakeAutopilot, address, tmp_path):
    with (
        make_uav(address, barriers=str(tmp_path), programs=["uav1", "uav2"]) as uav,
        pytest.raises(NotConfirmedError, match=r"after 0.1 s: 1 of 2 programs .* missing: uav2"),
    ):
        uav.wait_for("start", timeout=0.1)


def test_flying_vehicle_holds_its_position_while_it_waits(autopilot: FakeAutopilot, address, tmp_path):
    with make_uav(address, barriers=str(tmp_path), programs=["uav1", "uav2"]) as uav:
        until(lambda: uav.ekf.age_s < 0.5 and uav.info.is_connected)
        uav.start_offboard_mission()
        autopilot.pos = (3.0, 4.0, -1.5)
        until(lambda: uav.ekf.pos[2] == -1.5)
        other, sent = StartBarrier("uav2", tmp_path, ["uav1", "uav2"]), len(autopilot.setpoints)
        arrival = threading.Thread(
            target=lambda: (
                until(lambda: len(autopilot.setpoints) > sent + 5),
                other.arrive("start", uav.clock.now()),
            )
        )
        arrival.start()
        start = uav.wait_for("start")
        assert uav.clock.now() - start >= 0.0
        arrival.join()
    held = [m for _, m in autopilot.setpoints[sent + 1 :]]
    assert {(round(m.x, 6), round(m.y, 6), round(m.z, 6)) for m in held} == {(3.0, 4.0, -1.5)}


def test_program_that_arrives_again_after_a_timeout_meets_the_others(barriers):
    first = [barrier.arrive("start", 1.0) for barrier in barriers[:2]]
    for waiting in first:
        waiting.withdraw()
    again = [barrier.arrive("start", 30.0 + k) for k, barrier in enumerate(barriers)]
    assert {w.arrivals().start_s for w in again} == {32.0 + START_DELAY_S}


def test_forked_process_does_not_keep_the_arrival_of_its_program(barriers):
    waiting = barriers[0].arrive("start", 1.0)
    barriers[1].arrive("start", 2.0)
    barriers[2].arrive("start", 3.0)
    started, ended = os.pipe(), os.pipe()
    child = os.fork()
    if not child:
        os.write(started[1], b"x")
        os.read(ended[0], 1)
        os._exit(0)
    try:
        os.read(started[0], 1)
        assert waiting.arrivals().start_s == 3.0 + START_DELAY_S
        barriers[1].close()  # its program ends, the child does not
        assert waiting.arrivals().start_s is None
    finally:
        os.write(ended[1], b"x")
        os.waitpid(child, 0)
        for fd in (*started, *ended):
            os.close(fd)
