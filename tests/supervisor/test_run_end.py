"""Decisions about the end of a run, without processes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from arena.supervisor.process_state import Exit, ProcessStatus, State
from arena.supervisor.run_end import (
    Cause,
    End,
    armed,
    exit_code,
    failures,
    grounded,
    is_done,
    lost,
    may_fly,
    may_stop,
    settle_s,
)

from .conftest import plan_of, program, spec, vehicle, world

READY = ProcessStatus(state=State.READY, started=1)
DONE = ProcessStatus(state=State.EXITED, started=1, exit=Exit(code=0, text="exit 0"))
FAILED = ProcessStatus(state=State.EXITED, started=1, reason="exit 3", exit=Exit(code=3, text="exit 3"))
GIVEN_UP = ProcessStatus(state=State.FATAL, started=3, reason="gave up")
PLAN = plan_of(
    world(), program("p", "x", vehicle="uav1", needs=("world",)), vehicles=(vehicle("uav1"), vehicle("uav2"))
)


def test_armed_vehicle_may_fly():
    statuses = {"world": READY, "p": READY}
    assert may_fly(PLAN, statuses, {"uav1.armed": True, "uav2.armed": False}, {}) == ["uav1"]


def test_vehicle_that_only_its_link_reports_as_armed_may_fly():
    """The router receives the heartbeat later, and reports the vehicle as disarmed until then."""
    plan = plan_of(spec("link.uav1", "x", kind="link", vehicle="uav1"), vehicles=(vehicle(simulated=False),))
    facts, stats = {"uav1.armed": False}, {"link.uav1": {"armed": True}}
    assert may_fly(plan, {"link.uav1": READY}, facts, facts, stats) == ["uav1"]
    assert may_fly(plan, {"link.uav1": DONE}, facts, facts, stats) == []


def test_unknown_vehicle_may_fly_once_a_program_has_run():
    assert may_fly(PLAN, {"world": READY, "p": ProcessStatus()}, {}, {}) == []
    assert may_fly(PLAN, {"world": READY, "p": DONE}, {}, {}) == ["uav1", "uav2"]
    assert may_fly(PLAN, {"world": READY, "p": ProcessStatus()}, {}, {"uav2.armed": True}) == ["uav2"]


def test_simulated_vehicles_do_not_fly_without_their_world():
    facts, statuses = {"uav1.armed": True}, {"world": GIVEN_UP, "p": READY}
    assert may_fly(PLAN, statuses, facts, facts) == []
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    assert may_fly(real, statuses, facts, facts) == ["uav1"]


def test_real_vehicle_without_facts_does_not_delay_the_end():
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    statuses = {"world": READY, "p": DONE}
    assert may_fly(real, statuses, {}, {}) == []
    assert may_fly(real, statuses, {}, {"uav1.connected": False, "uav1.armed": True}) == ["uav1"]


def world_report(
    crashed: str = "", *, airborne: bool = False, px4: str = "in step"
) -> dict[str, dict[str, object]]:
    """Return the stats of a world about uav1."""
    return {
        "world": {
            "vehicles": {"uav1": {"crashed": crashed, "airborne": airborne}},
            "autopilot": {"uav1": {"px4": px4}},
        }
    }


def test_crashed_vehicle_on_the_floor_is_not_waited_for():
    statuses, armed = {"world": READY, "p": DONE}, {"uav1.armed": True, "uav2.armed": False}
    crashed = world_report("tilted 61 degrees at 3.20 s")
    assert may_fly(PLAN, statuses, armed, armed, crashed) == [] and is_done(PLAN, statuses, armed, crashed)
    assert grounded(PLAN, statuses, crashed) == {"uav1": "crashed: tilted 61 degrees at 3.20 s"}
    assert may_fly(PLAN, statuses, armed, armed, world_report()) == ["uav1"]
    assert not is_done(PLAN, statuses, armed, world_report())


def test_crashed_vehicle_in_the_air_is_landed():
    statuses, armed = {"world": READY, "p": DONE}, {"uav1.armed": True, "uav2.armed": False}
    assert may_fly(PLAN, statuses, armed, armed, world_report("touched a wall at 3.20 s", airborne=True)) == [
        "uav1"
    ]


@pytest.mark.parametrize(
    ("px4", "why"),
    [
        ("never connected", "its PX4 has never connected to the world"),
        ("gone", "its PX4 has closed its connection"),
        ("booting", "its PX4 has not finished booting"),
        ("late", "its PX4 does not reply"),
        ("in step", ""),
    ],
)
def test_vehicle_without_motor_commands_is_down_on_the_floor(px4: str, why: str):
    statuses = {"world": READY, "p": DONE}
    assert grounded(PLAN, statuses, world_report(px4=px4)).get("uav1", "") == why
    assert grounded(PLAN, statuses, world_report(px4=px4, airborne=True)) == {}


def test_only_its_own_autopilot_reports_a_real_vehicle_down():
    real = replace(PLAN, vehicles=(vehicle("uav1", simulated=False),))
    for report in (world_report("tilted 61 degrees at 3.20 s"), world_report(px4="never connected")):
        assert may_fly(real, {"world": READY, "p": DONE}, {"uav1.armed": True}, {}, report) == ["uav1"]


def test_crash_reported_by_a_program_is_ignored():
    report = {"p": world_report("tilted 61 degrees at 3.20 s")["world"]}
    assert grounded(PLAN, {"world": READY, "p": READY}, report) == {}


def test_run_is_done_when_programs_ended_and_vehicles_disarmed():
    disarmed = {"uav1.armed": False, "uav2.armed": False}
    assert is_done(PLAN, {"world": READY, "p": DONE}, disarmed)
    assert is_done(PLAN, {"world": READY, "p": FAILED}, disarmed)
    assert not is_done(PLAN, {"world": READY, "p": READY}, disarmed)
    assert not is_done(PLAN, {"world": READY, "p": DONE}, {"uav1.armed": False})
    assert not is_done(PLAN, {"world": READY, "p": DONE}, {**disarmed, "uav2.armed": True})
    assert not is_done(PLAN, {"world": ProcessStatus(state=State.BACKOFF), "p": DONE}, disarmed)


def test_world_has_time_for_the_last_steps_of_a_repeatable_flight():
    assert settle_s(PLAN, {"world": {"last_steps": True}}) == 60.0
    assert settle_s(PLAN, {"world": {"last_steps": False}}) == settle_s(PLAN, {}) == 0.5


def test_run_is_lost_only_with_a_process_that_all_need():
    plan = plan_of(
        spec("all", "x", kind="router"),
        spec("one", "x", kind="forward", vehicle="uav1"),
        spec("none", "x", kind="mocap"),
        program("p", "x", needs=("all", "one")),
    )
    good = dict.fromkeys(("all", "one", "none", "p"), READY)
    assert lost(plan, {**good, "all": GIVEN_UP}) == "all: gave up"
    assert lost(plan, {**good, "all": DONE}) != ""
    assert lost(plan, {**good, "one": GIVEN_UP}) == lost(plan, {**good, "none": GIVEN_UP}) == ""


def test_run_is_not_lost_without_a_tool():
    plan = plan_of(spec("tool.bag", "x", kind="tool"), program("p", "x", needs=("tool.bag",)))
    assert lost(plan, {"tool.bag": GIVEN_UP, "p": READY}) == ""


def test_run_is_not_lost_without_its_recorder():
    plan = plan_of(spec("recorder", "x", kind="recorder"), program("p", "x", needs=("recorder",)))
    assert lost(plan, {"recorder": GIVEN_UP, "p": READY}) == ""


def test_task_is_usable_after_exit_0():
    plan = plan_of(spec("t", "x", kind="task", ready="started"), program("p", "x", needs=("t",)))
    assert lost(plan, {"t": DONE, "p": READY}) == ""
    assert lost(plan, {"t": FAILED, "p": READY}) != ""


def test_processes_stop_after_those_that_need_them():
    plan = plan_of(
        spec("a", "x"),
        spec("b", "x", needs=("a",)),
        spec("c", "x", needs=("a",)),
        spec("d", "x", needs=("b", "c")),
    )
    statuses, order = dict.fromkeys("abcd", READY), []
    while alive := {name for name, status in statuses.items() if status is READY}:
        turn = may_stop(plan, statuses) & alive
        order.append(turn)
        statuses.update(dict.fromkeys(turn, DONE))
    assert order == [{"d"}, {"b", "c"}, {"a"}]


def verdict(cause, p, *, landed=True, until_done=True, stats=None, last=None):
    statuses = {"world": READY, "p": p}
    end = End(cause=cause, why="because", statuses=statuses)
    failed = failures(PLAN, end, {**statuses, "p": last or p}, stats or {}, landed, until_done)
    return exit_code(end, failed, landed)


def test_exit_code_is_0_only_without_failure_and_crash():
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


def test_stop_by_the_user_succeeds_except_for_ctrl_c():
    for cause in (Cause.DOWN, Cause.TERMINATED, Cause.HANGUP):
        assert verdict(cause, READY, last=FAILED, until_done=False) == 0
        assert verdict(cause, READY, last=FAILED, until_done=True) == 1
        assert verdict(cause, FAILED, until_done=False) == 1
    assert verdict(Cause.INTERRUPT, READY, last=FAILED) == 130


@pytest.mark.parametrize("state", ["booting", "running", "late", "gone"])
def test_armed_flight_controller_in_the_loop_is_not_grounded(state):
    plan = replace(PLAN, vehicles=(replace(vehicle("uav1"), autopilot="hitl"),))
    stats = {
        "world": {
            "vehicles": {"uav1": {"airborne": False, "crashed": "rolled"}},
            "autopilot": {"uav1": {"px4": state}},
        }
    }
    statuses, facts = {"world": READY, "p": DONE}, {"uav1.armed": True}
    assert grounded(plan, statuses, stats) == {} and not is_done(plan, statuses, facts, stats)
    assert may_fly(plan, statuses, facts, facts, stats) == ["uav1"]
    absent = {
        "world": {
            "vehicles": {"uav1": {"airborne": False}},
            "autopilot": {"uav1": {"px4": "never connected"}},
        }
    }
    assert grounded(plan, statuses, absent) == {"uav1": "its PX4 has never connected to the world"}


def test_program_that_ctrl_c_ended_has_not_failed():
    statuses = {"world": READY, "p": READY}
    for cause, expected in ((Cause.INTERRUPT, []), (Cause.DOWN, ["p: had not ended by itself (exit 1)"])):
        end = End(cause=cause, why="because", statuses=statuses)
        found = failures(PLAN, end, {**statuses, "p": FAILED}, {}, landed=True, until_done=True)
        assert [text.partition(" (")[0] for text in found] == [text.partition(" (")[0] for text in expected]


def test_unconfirmed_landing_fails_every_end():
    for cause, until_done in itertools.product(Cause, (True, False)):
        assert verdict(cause, DONE, landed=False, until_done=until_done) == 1


REPLAY = replace(
    plan_of(spec("replay", "sleeps", kind="replay"), vehicles=(vehicle("uav1"),)),
    replay="/runs/a/flight.mcap",
)


def test_nothing_flies_in_a_replay_whatever_was_recorded():
    statuses, facts = {"replay": READY}, {"uav1.armed": True}
    assert may_fly(REPLAY, statuses, facts, facts) == []
    assert armed(REPLAY, statuses, facts) == set()


def test_plan_with_a_real_vehicle_is_never_treated_as_a_replay():
    real = replace(REPLAY, vehicles=(vehicle("uav1", simulated=False),))
    facts = {"uav1.armed": True}
    assert may_fly(real, {"replay": READY}, facts, facts) == ["uav1"]
    assert armed(real, {"replay": READY}, facts) == {"uav1"}


def test_replay_is_done_at_the_end_of_the_record():
    facts = {"uav1.armed": False}
    assert not is_done(REPLAY, {"replay": READY}, facts, {"replay": {"finished": False}})
    assert is_done(REPLAY, {"replay": READY}, {"uav1.armed": True}, {"replay": {"finished": True}})


def test_replay_that_has_failed_ends_the_run():
    assert lost(REPLAY, {"replay": FAILED}) == "replay: exit 3"
