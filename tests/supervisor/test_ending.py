"""What is decided about a whole run, without running one."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from arena.supervisor.process_state import Exit, ProcessStatus, State
from arena.supervisor.run_end import (
    Cause,
    End,
    exit_code,
    failures,
    grounded,
    is_done,
    lost,
    may_fly,
    may_stop,
)

from .conftest import plan_of, program, spec, vehicle, world

READY = ProcessStatus(state=State.READY, started=1)
DONE = ProcessStatus(state=State.EXITED, started=1, exit=Exit(code=0, text="exit 0"))
FAILED = ProcessStatus(state=State.EXITED, started=1, reason="exit 3", exit=Exit(code=3, text="exit 3"))
GIVEN_UP = ProcessStatus(state=State.FATAL, started=3, reason="gave up")
PLAN = plan_of(
    world(), program("p", "x", vehicle="uav1", needs=("world",)), vehicles=(vehicle("uav1"), vehicle("uav2"))
)


def test_a_vehicle_flies_while_it_is_armed_and_not_when_it_is_not():
    lives = {"world": READY, "p": READY}
    assert may_fly(PLAN, lives, {"uav1.armed": True, "uav2.armed": False}, {}) == ["uav1"]


def test_unknown_counts_as_flying_once_a_program_has_run_or_it_was_last_heard_armed():
    assert may_fly(PLAN, {"world": READY, "p": ProcessStatus()}, {}, {}) == []
    assert may_fly(PLAN, {"world": READY, "p": DONE}, {}, {}) == ["uav1", "uav2"]
    assert may_fly(PLAN, {"world": READY, "p": ProcessStatus()}, {}, {"uav2.armed": True}) == ["uav2"]


def test_simulated_vehicles_are_gone_with_their_world_and_real_ones_are_not():
    facts, lives = {"uav1.armed": True}, {"world": GIVEN_UP, "p": READY}
    assert may_fly(PLAN, lives, facts, facts) == []
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    assert may_fly(real, lives, facts, facts) == ["uav1"]


def test_a_real_vehicle_that_was_never_switched_on_holds_up_no_end():
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    lives = {"world": READY, "p": DONE}
    assert may_fly(real, lives, {}, {}) == []
    assert may_fly(real, lives, {}, {"uav1.connected": False, "uav1.armed": True}) == ["uav1"]


def seen(crashed: str = "", *, airborne: bool = False, px4: str = "in step") -> dict[str, dict[str, object]]:
    """What the world tells of uav1."""
    return {
        "world": {
            "vehicles": {"uav1": {"crashed": crashed, "airborne": airborne}},
            "autopilot": {"uav1": {"px4": px4}},
        }
    }


def test_a_simulated_vehicle_that_lies_on_the_floor_crashed_is_not_waited_for():
    lives, armed = {"world": READY, "p": DONE}, {"uav1.armed": True, "uav2.armed": False}
    crashed = seen("tilted 61 degrees at 3.20 s")
    assert may_fly(PLAN, lives, armed, armed, crashed) == [] and is_done(PLAN, lives, armed, crashed)
    assert grounded(PLAN, lives, crashed) == {"uav1": "crashed: tilted 61 degrees at 3.20 s"}
    assert may_fly(PLAN, lives, armed, armed, seen()) == ["uav1"]
    assert not is_done(PLAN, lives, armed, seen())


def test_one_that_has_touched_something_and_flies_on_is_landed_as_any_other():
    lives, armed = {"world": READY, "p": DONE}, {"uav1.armed": True, "uav2.armed": False}
    assert may_fly(PLAN, lives, armed, armed, seen("touched a wall at 3.20 s", airborne=True)) == ["uav1"]


@pytest.mark.parametrize(
    ("px4", "why"),
    [
        ("never connected", "its PX4 has never connected to the world"),
        ("gone", "its PX4 has closed its connection"),
        ("booting", "its PX4 has not begun to fly"),
        ("late", "its PX4 does not answer"),
        ("in step", ""),
    ],
)
def test_one_whose_px4_commands_no_motor_stands_where_the_world_sees_it_stand(px4: str, why: str):
    lives = {"world": READY, "p": DONE}
    assert grounded(PLAN, lives, seen(px4=px4)).get("uav1", "") == why
    assert grounded(PLAN, lives, seen(px4=px4, airborne=True)) == {}


def test_of_a_real_vehicle_only_its_own_word_counts():
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    for told in (seen("tilted 61 degrees at 3.20 s"), seen(px4="never connected")):
        assert may_fly(real, {"world": READY, "p": DONE}, {"uav1.armed": True}, {}, told) == ["uav1"]


def test_a_program_cannot_say_that_a_vehicle_has_crashed_to_have_it_left_in_the_air():
    told = {"p": seen("tilted 61 degrees at 3.20 s")["world"]}
    assert grounded(PLAN, {"world": READY, "p": READY}, told) == {}


def test_done_needs_every_program_ended_and_every_vehicle_known_to_be_disarmed():
    disarmed = {"uav1.armed": False, "uav2.armed": False}
    assert is_done(PLAN, {"world": READY, "p": DONE}, disarmed)
    assert is_done(PLAN, {"world": READY, "p": FAILED}, disarmed)
    assert not is_done(PLAN, {"world": READY, "p": READY}, disarmed)
    assert not is_done(PLAN, {"world": READY, "p": DONE}, {"uav1.armed": False})
    assert not is_done(PLAN, {"world": READY, "p": DONE}, {**disarmed, "uav2.armed": True})
    assert not is_done(PLAN, {"world": ProcessStatus(state=State.BACKOFF), "p": DONE}, disarmed)


def test_a_run_is_lost_with_what_all_need_but_not_with_what_one_vehicle_needs():
    plan = plan_of(
        spec("all", "x"),
        spec("one", "x", vehicle="uav1"),
        spec("none", "x"),
        program("p", "x", needs=("all", "one")),
    )
    good = dict.fromkeys(("all", "one", "none", "p"), READY)
    assert lost(plan, {**good, "all": GIVEN_UP}) == "all: gave up"
    assert lost(plan, {**good, "all": DONE}) != ""
    assert lost(plan, {**good, "one": GIVEN_UP}) == lost(plan, {**good, "none": GIVEN_UP}) == ""


def test_a_task_serves_by_having_ended_well():
    plan = plan_of(spec("t", "x", kind="task", ready="started"), program("p", "x", needs=("t",)))
    assert lost(plan, {"t": DONE, "p": READY}) == ""
    assert lost(plan, {"t": FAILED, "p": READY}) != ""


def test_every_process_gets_its_turn_to_stop_after_all_that_need_it():
    plan = plan_of(
        spec("a", "x"),
        spec("b", "x", needs=("a",)),
        spec("c", "x", needs=("a",)),
        spec("d", "x", needs=("b", "c")),
    )
    lives, order = dict.fromkeys("abcd", READY), []
    while alive := {name for name, life in lives.items() if life is READY}:
        turn = may_stop(plan, lives) & alive
        order.append(turn)
        lives.update(dict.fromkeys(turn, DONE))
    assert order == [{"d"}, {"b", "c"}, {"a"}]


def verdict(cause, p, *, landed=True, until_done=True, stats=None, last=None):
    lives = {"world": READY, "p": p}
    end = End(cause=cause, why="because", statuses=lives)
    failed = failures(PLAN, end, {**lives, "p": last or p}, stats or {}, landed, until_done)
    return exit_code(end, failed, landed)


def test_the_exit_code_is_0_only_when_every_program_did_and_nothing_crashed():
    assert verdict(Cause.DONE, DONE) == 0
    assert verdict(Cause.DONE, FAILED) == 1
    assert verdict(Cause.DONE, GIVEN_UP) == 1
    assert (
        verdict(Cause.DONE, DONE, stats={"world": {"vehicles": {"uav1": {"crashed": "floor at 3 m/s"}}}}) == 1
    )
    assert (
        verdict(
            Cause.DONE,
            DONE,
            stats={"world": {"vehicles": {"uav1": {"crashed": ""}, "uav2": 3}}, "x": {"vehicles": 7}},
        )
        == 0
    )
    assert verdict(Cause.LOST, DONE) == 1


def test_a_user_stop_is_good_but_for_ctrl_c_and_programs_it_interrupted_are_no_failures():
    for cause in (Cause.DOWN, Cause.TERMINATED, Cause.HANGUP):
        assert verdict(cause, READY, last=FAILED, until_done=False) == 0
        assert verdict(cause, READY, last=FAILED, until_done=True) == 1
        assert verdict(cause, FAILED, until_done=False) == 1
    assert verdict(Cause.INTERRUPT, READY, last=FAILED) == 130


def test_a_landing_that_is_not_confirmed_fails_every_end():
    for cause, until_done in itertools.product(Cause, (True, False)):
        assert verdict(cause, DONE, landed=False, until_done=until_done) == 1
