"""The decisions about one process, without a process."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.plan.model import ProcessSpec, Restart
from arena.plan.program_slice import program_restart
from arena.supervisor.process_state import ALIVE, ENDED, Action, Exit, Observation, ProcessStatus, State, step

SPEC = ProcessSpec(
    name="x",
    kind="tool",
    argv=("x",),
    start_timeout_s=5.0,
    stop_timeout_s=2.0,
    restart=Restart(mode="on_failure", limit=3, window_s=30.0, backoff_s=0.25),
)
NEVER = ProcessSpec(name="x", kind="program", argv=("x",), ready="started")
READY_NEEDS = Observation(needs_ready=True)
FAILED = Exit(code=1, text="exit 1")
KILLED = Exit(code=137, text="killed by SIGKILL")


def walk(spec, *moves, status=None):
    """Apply (time, Observation) pairs in order. Return the last status and every action."""
    status, actions = status or ProcessStatus(), []
    for now, observation in moves:
        status, action = step(spec, status, observation, now)
        actions.append(action)
    return status, actions


def test_process_waits_for_needs_and_is_ready_by_proof():
    status, actions = walk(
        SPEC,
        (0, Observation()),
        (1, READY_NEEDS),
        (4.9, Observation()),
        (4.95, Observation(proof="reported ready")),
    )
    assert actions == [Action.NONE, Action.START, Action.NONE, Action.NONE]
    assert status.state is State.READY and status.reason == "reported ready"


def test_start_timeout_without_proof_stops_the_process():
    status, actions = walk(SPEC, (0, READY_NEEDS), (5.0, Observation()))
    assert status.state is State.STOPPING and actions[-1] is Action.TERMINATE


def test_a_dead_need_is_fatal_and_named():
    status, _ = walk(SPEC, (0, Observation(needs_dead="world")))
    assert status.state is State.FATAL and "world" in status.reason


def test_backoff_doubles_with_each_failure():
    status, _ = walk(SPEC, (0, READY_NEEDS), (0.1, Observation(proof="p")), (1, Observation(exit=FAILED)))
    assert status.state is State.BACKOFF and status.next_at == 1.25
    status, actions = walk(
        SPEC,
        (1.24, READY_NEEDS),
        (1.25, READY_NEEDS),
        (1.3, Observation(proof="p")),
        (2, Observation(exit=FAILED)),
        status=status,
    )
    assert actions[:2] == [Action.NONE, Action.START] and status.next_at == 2.5


def test_failures_outside_the_window_do_not_add_up():
    status = ProcessStatus()
    for i in range(20):
        status, _ = walk(
            SPEC,
            (100 * i, READY_NEEDS),
            (100 * i + 1, Observation(proof="p")),
            (100 * i + 90, Observation(exit=FAILED)),
            status=status,
        )
        assert status.state is State.BACKOFF


def test_never_ready_fails_even_when_starts_are_far_apart():
    status, now = ProcessStatus(), 0.0
    for _ in range(3):
        status, _ = walk(
            SPEC,
            (now, READY_NEEDS),
            (now + 40, Observation()),
            (now + 41, Observation(exit=FAILED)),
            status=status,
        )
        now += 100
    assert status.state is State.FATAL and "gave up after 3 starts" in status.reason


def test_exit_0_is_accepted_by_on_failure_not_by_always():
    moves = (
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (2, Observation(exit=Exit(code=0, text="exit 0"))),
    )
    assert walk(SPEC, *moves)[0].state is State.EXITED
    always = ProcessSpec(name="x", kind="tool", argv=("x",), restart=Restart(mode="always"))
    assert walk(always, *moves)[0].state is State.BACKOFF


def test_program_that_ends_within_one_round_has_run():
    status, _ = walk(NEVER, (0, READY_NEEDS), (0.1, Observation(exit=Exit(code=0, text="exit 0"))))
    assert status.state is State.EXITED


def test_process_that_does_not_stop_is_killed_repeatedly():
    _, actions = walk(
        SPEC,
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (2, Observation(stop=True)),
        (3.9, Observation(stop=True)),
        (4, Observation(stop=True)),
        (4.5, Observation(stop=True)),
        (5, Observation(stop=True)),
    )
    assert actions[2:] == [Action.TERMINATE, Action.NONE, Action.KILL, Action.NONE, Action.KILL]


def test_ready_and_ended_within_one_round_counts_as_ready():
    once = replace(SPEC, restart=Restart())
    status, _ = walk(once, (0, READY_NEEDS), (0.1, Observation(proof="p", exit=FAILED)))
    assert status.state is State.EXITED and status.unproven == 0


def test_kill_does_not_wait_for_the_stop_timeout():
    _, actions = walk(SPEC, (0, READY_NEEDS), (1, Observation(stop=True)), (1.1, Observation(kill=True)))
    assert actions[-1] is Action.KILL


def test_stop_during_backoff_ends_the_process():
    status, _ = walk(
        SPEC,
        (0, READY_NEEDS),
        (1, Observation(exit=FAILED)),
        (1.1, Observation(starts_on=False)),
        (9, READY_NEEDS),
    )
    assert status.state is State.EXITED


def test_requested_restart_resets_the_history():
    status, actions = walk(
        SPEC,
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (2, Observation(restart=True)),
        (3, Observation(exit=FAILED)),
    )
    assert actions[2:] == [Action.TERMINATE, Action.START] and status.starts == (3,)


def test_failed_process_can_be_restarted_on_request():
    status, actions = walk(SPEC, (0, Observation(needs_dead="w")), (1, Observation(restart=True)))
    assert actions[-1] is Action.START and status.state is State.STARTING


def test_process_stopped_by_a_signal_is_killed_after_its_limit():
    began, _ = walk(SPEC, (0, READY_NEEDS), (1, Observation(proof="p")))
    status, actions = walk(
        SPEC,
        (5, Observation(stopped=True)),
        (5.9, Observation(stopped=True)),
        (6, Observation(stopped=True)),
        status=began,
    )
    assert actions == [Action.NONE, Action.NONE, Action.KILL] and status.state is State.STOPPING
    status, _ = walk(SPEC, (6.1, Observation(exit=KILLED)), status=status)
    assert (
        status.state is State.BACKOFF
        and status.reason == "paused for 1.0 s, then killed by SIGKILL; again in 0.25 s"
    )
    status, actions = walk(
        SPEC,
        (7, READY_NEEDS),
        (7.1, Observation(stopped=True)),
        (8, Observation(stopped=True)),
        status=status,
    )
    assert actions == [Action.START, Action.NONE, Action.NONE], (
        "the stop time of the next process starts at 0"
    )


def test_continued_process_survives_and_its_stop_time_restarts():
    began, _ = walk(SPEC, (0, READY_NEEDS), (1, Observation(proof="p")))
    moves = (
        (5, Observation(stopped=True)),
        (5.9, Observation()),
        (6, Observation(stopped=True)),
        (6.9, Observation(stopped=True)),
        (7, Observation()),
    )
    status, actions = walk(SPEC, *moves, status=began)
    assert set(actions) == {Action.NONE} and status.state is State.READY and status.stopped_at is None


def test_stopped_process_without_restart_policy_fails():
    once, left = (replace(SPEC, restart=Restart(), stopped_for_s=limit_s) for limit_s in (1.0, None))
    moves = (
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (5, Observation(stopped=True)),
        (7, Observation(stopped=True)),
    )
    status, actions = walk(once, *moves, (7.1, Observation(exit=KILLED)))
    assert status.state is State.FATAL and status.reason == "paused for 2.0 s, then killed by SIGKILL"
    status, actions = walk(left, *moves, (700, Observation(stopped=True)))
    assert status.state is State.READY and Action.KILL not in actions


def test_silent_process_is_killed_once_ready_if_it_has_a_limit():
    limited = replace(SPEC, silent_for_s=5.0)
    moves = (
        (0, READY_NEEDS),
        (1, Observation(silent_s=9.0)),
        (2, Observation(proof="p")),
        (6, Observation(silent_s=4.9)),
        (7, Observation(silent_s=5.2)),
    )
    status, actions = walk(limited, *moves)
    assert actions[-1] is Action.KILL and Action.KILL not in actions[:-1]
    status, _ = walk(limited, (7.1, Observation(exit=KILLED)), status=status)
    assert status.state is State.BACKOFF and status.reason.startswith(
        "sent nothing for 5.2 s, then killed by SIGKILL"
    )
    assert Action.KILL not in walk(SPEC, *moves)[1]


observations = st.builds(
    Observation,
    silent_s=st.floats(0, 100),
    stopped=st.booleans(),
    needs_ready=st.booleans(),
    needs_dead=st.sampled_from(["", "", "", "w"]),
    proof=st.sampled_from(["", "", "p"]),
    exit=st.sampled_from(
        [None, None, FAILED, Exit(code=0, text="exit 0"), Exit(code=127, text="no", ran=False)]
    ),
    starts_on=st.booleans(),
    stop=st.booleans(),
    kill=st.sampled_from([False, False, True]),
    restart=st.sampled_from([False, False, True]),
)
specs = st.builds(
    ProcessSpec,
    name=st.just("x"),
    kind=st.just("tool"),
    argv=st.just(("x",)),
    ready=st.sampled_from(["reported", "started"]),
    restart=st.builds(
        Restart, mode=st.sampled_from(["never", "on_failure", "always"]), limit=st.integers(1, 4)
    ),
)
walks = st.lists(st.tuples(st.floats(0.0, 20.0), observations), max_size=60)


@given(specs, walks)
def test_any_sequence_starts_one_process_and_signals_only_it(spec, moves):
    status, now = ProcessStatus(), 0.0
    for wait_s, observation in moves:
        now += wait_s
        before, (status, action) = status, step(spec, status, observation, now)
        gone = before.state not in ALIVE or observation.exit is not None
        assert action is not Action.START or gone
        assert action not in (Action.TERMINATE, Action.KILL) or not gone
        assert (status.state in ALIVE) == (
            action is Action.START or (before.state in ALIVE and observation.exit is None)
        )
        assert status.reason
        assert status.state is before.state or status.since == now


@given(specs, walks)
def test_nothing_starts_after_starts_are_off(spec, moves):
    status, now = ProcessStatus(), 0.0
    for i, (wait_s, observation) in enumerate(moves):
        now += wait_s
        off = i >= len(moves) // 2
        status, action = step(
            spec, status, replace(observation, starts_on=observation.starts_on and not off), now
        )
        assert not (off and action is Action.START)


@given(specs, st.floats(0.3, 3.0))
def test_process_that_fails_at_every_start_fails_for_good(spec, wait_s):
    status, starts = ProcessStatus(), 0
    for now in (i * wait_s for i in range(30)):
        status, action = step(
            spec, status, Observation(needs_ready=True, exit=FAILED if status.state in ALIVE else None), now
        )
        starts += action is Action.START
    assert status.state in ENDED
    assert starts <= spec.restart.limit


def test_process_is_not_killed_while_its_vehicle_is_armed():  # review fault 6
    """A process that serves an armed real vehicle continues after its stop signal."""
    moves = [(0, READY_NEEDS), (1, Observation(proof="p")), (2, Observation(stop=True))]
    held = [(t, Observation(stop=True, hold=True)) for t in (4.5, 10, 100)]
    status, actions = walk(SPEC, *moves, *held)
    assert status.state is State.STOPPING and actions[2:] == [Action.TERMINATE, *[Action.NONE] * 3]
    assert walk(SPEC, *moves, *held, (101, Observation(stop=True)))[1][-1] is Action.KILL
    assert walk(SPEC, *moves, *held, (101, Observation(hold=True, kill=True)))[1][-1] is Action.KILL


def test_restart_in_flight_does_not_wait_for_a_process_that_continues():
    moves = [(0, READY_NEEDS), (1, Observation(proof="p")), (2, Observation(restart=True, hold=True))]
    assert walk(SPEC, *moves)[1][-1] is Action.KILL


def test_hung_process_is_killed_also_while_its_vehicle_is_armed():
    hung = replace(SPEC, silent_for_s=6.0)
    moves = [(0, READY_NEEDS), (1, Observation(proof="p")), (8, Observation(silent_s=6.5, hold=True))]
    assert walk(hung, *moves)[1][-1] is Action.KILL


FLIES = replace(NEVER, restart=Restart(mode="on_failure", backoff_s=2.0))
"""A user program that is started again after an error."""


@pytest.mark.parametrize(
    "moves",
    [
        [(1, Observation(armed=True)), (2, Observation()), (3, Observation(exit=FAILED))],
        [(1, Observation(exit=FAILED, armed=True))],
        [(1, Observation(exit=FAILED)), (1.9, Observation(needs_ready=True, armed=True))],
        [
            (1, Observation(armed=True, stopped=True)),
            (2, Observation(stopped=True)),
            (3, Observation(exit=KILLED)),
        ],
    ],
    ids=["landed, then error", "error in flight", "heartbeat after the error", "paused"],
)
def test_program_that_flew_a_real_vehicle_is_not_started_again(moves):
    began = [(0, READY_NEEDS), (0.1, Observation(proof="started"))]
    status, actions = walk(FLIES, *began, *moves, (10, READY_NEEDS))
    assert status.state is State.FATAL and actions.count(Action.START) == 1
    assert status.reason.endswith(
        "its real vehicle was armed, or may have been. Only `arena restart` starts it"
    )


def test_person_starts_a_program_that_flew_again_and_its_next_error_is_retried():
    flown = [(0, READY_NEEDS), (1, Observation(armed=True)), (3, Observation(exit=FAILED))]
    again = [
        (20, Observation(restart=True, needs_ready=True)),
        (40, Observation(exit=FAILED)),
        (42, READY_NEEDS),
    ]
    status, actions = walk(FLIES, *flown, *again)
    assert status.state is State.STARTING and actions.count(Action.START) == 3


def test_program_that_flew_and_ends_without_error_has_not_failed():
    status, _ = walk(
        FLIES,
        (0, READY_NEEDS),
        (1, Observation(armed=True)),
        (3, Observation(exit=Exit(code=0, text="exit 0"))),
    )
    assert status.state is State.EXITED and status.reason == "exit 0"


@pytest.mark.parametrize("runs_s", [0.1, 5.0])
def test_program_of_a_real_vehicle_that_fails_quickly_is_given_up_after_five_starts(runs_s):
    """But one that waits 20 s for a condition of arming is tried again and again."""
    vehicle = SimpleNamespace(program=SimpleNamespace(restart="on_failure"), simulated=False)
    spec = replace(NEVER, restart=program_restart(vehicle))
    assert starts_in(600.0, spec, runs_s) == (5, State.FATAL)
    assert starts_in(600.0, spec, 20.0)[0] > 15


def starts_in(limit_s, spec, runs_s):
    """Return (number of starts, last state) of a program that fails after `runs_s`."""
    status, now, starts = ProcessStatus(), 0.0, 0
    while now < limit_s and status.state not in ENDED:
        status, action = step(spec, status, READY_NEEDS, now)
        if action is Action.START:
            status, _ = step(spec, status, Observation(proof="started"), now)
            starts, now = starts + 1, now + runs_s
            status, _ = step(spec, status, Observation(exit=FAILED), now)
        now += 0.25
    return starts, status.state
