"""The one decision about one process, without a process."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from arena.plan.model import ProcessSpec, Restart
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


def walk(spec, *moves, life=None):
    """Apply (time, Observation) one after the other; returns the last life and every action."""
    life, actions = life or ProcessStatus(), []
    for now, seen in moves:
        life, action = step(spec, life, seen, now)
        actions.append(action)
    return life, actions


def test_it_waits_for_its_needs_then_starts_and_is_ready_only_by_proof():
    life, actions = walk(
        SPEC,
        (0, Observation()),
        (1, READY_NEEDS),
        (4.9, Observation()),
        (4.95, Observation(proof="it says so")),
    )
    assert actions == [Action.NONE, Action.START, Action.NONE, Action.NONE]
    assert life.state is State.READY and life.reason == "it says so"


def test_surviving_the_start_time_out_is_no_proof():
    life, actions = walk(SPEC, (0, READY_NEEDS), (5.0, Observation()))
    assert life.state is State.STOPPING and actions[-1] is Action.TERMINATE


def test_a_dead_need_is_fatal_and_named():
    life, _ = walk(SPEC, (0, Observation(needs_dead="world")))
    assert life.state is State.FATAL and "world" in life.reason


def test_the_back_off_doubles_and_is_waited_for():
    life, _ = walk(SPEC, (0, READY_NEEDS), (0.1, Observation(proof="p")), (1, Observation(exit=FAILED)))
    assert life.state is State.BACKOFF and life.next_at == 1.25
    life, actions = walk(
        SPEC,
        (1.24, READY_NEEDS),
        (1.25, READY_NEEDS),
        (1.3, Observation(proof="p")),
        (2, Observation(exit=FAILED)),
        life=life,
    )
    assert actions[:2] == [Action.NONE, Action.START] and life.next_at == 2.5


def test_deaths_far_apart_never_add_up_to_giving_up():
    life = ProcessStatus()
    for i in range(20):
        life, _ = walk(
            SPEC,
            (100 * i, READY_NEEDS),
            (100 * i + 1, Observation(proof="p")),
            (100 * i + 90, Observation(exit=FAILED)),
            life=life,
        )
        assert life.state is State.BACKOFF


def test_never_ready_is_given_up_though_its_starts_lie_further_apart_than_the_window():
    life, now = ProcessStatus(), 0.0
    for _ in range(3):
        life, _ = walk(
            SPEC,
            (now, READY_NEEDS),
            (now + 40, Observation()),
            (now + 41, Observation(exit=FAILED)),
            life=life,
        )
        now += 100
    assert life.state is State.FATAL and "gave up after 3 starts" in life.reason


def test_exit_0_satisfies_on_failure_but_not_always():
    moves = (
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (2, Observation(exit=Exit(code=0, text="exit 0"))),
    )
    assert walk(SPEC, *moves)[0].state is State.EXITED
    always = ProcessSpec(name="x", kind="tool", argv=("x",), restart=Restart(mode="always"))
    assert walk(always, *moves)[0].state is State.BACKOFF


def test_a_program_that_ends_within_one_turn_has_run():
    life, _ = walk(NEVER, (0, READY_NEEDS), (0.1, Observation(exit=Exit(code=0, text="exit 0"))))
    assert life.state is State.EXITED


def test_what_does_not_stop_in_time_is_killed_and_killed_again():
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


def test_kill_does_not_wait_for_the_stop_time_out():
    _, actions = walk(SPEC, (0, READY_NEEDS), (1, Observation(stop=True)), (1.1, Observation(kill=True)))
    assert actions[-1] is Action.KILL


def test_a_stop_during_the_back_off_ends_it():
    life, _ = walk(
        SPEC,
        (0, READY_NEEDS),
        (1, Observation(exit=FAILED)),
        (1.1, Observation(starts_on=False)),
        (9, READY_NEEDS),
    )
    assert life.state is State.EXITED


def test_a_restart_asked_for_starts_anew_with_a_clean_slate():
    life, actions = walk(
        SPEC,
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (2, Observation(restart=True)),
        (3, Observation(exit=FAILED)),
    )
    assert actions[2:] == [Action.TERMINATE, Action.START] and life.starts == (3,)


def test_the_given_up_can_be_started_by_a_person():
    life, actions = walk(SPEC, (0, Observation(needs_dead="w")), (1, Observation(restart=True)))
    assert actions[-1] is Action.START and life.state is State.STARTING


def test_what_a_signal_has_stopped_for_too_long_is_killed_and_started_again():
    began, _ = walk(SPEC, (0, READY_NEEDS), (1, Observation(proof="p")))
    life, actions = walk(
        SPEC,
        (5, Observation(stopped=True)),
        (5.9, Observation(stopped=True)),
        (6, Observation(stopped=True)),
        life=began,
    )
    assert actions == [Action.NONE, Action.NONE, Action.KILL] and life.state is State.STOPPING
    life, _ = walk(SPEC, (6.1, Observation(exit=KILLED)), life=life)
    assert (
        life.state is State.BACKOFF
        and life.reason == "stopped for 1.0 s, then killed by SIGKILL; again in 0.25 s"
    )
    life, actions = walk(
        SPEC, (7, READY_NEEDS), (7.1, Observation(stopped=True)), (8, Observation(stopped=True)), life=life
    )
    assert actions == [Action.START, Action.NONE, Action.NONE], "its successor's time is counted anew"


def test_what_goes_on_in_time_lives_and_the_next_stop_is_counted_anew():
    began, _ = walk(SPEC, (0, READY_NEEDS), (1, Observation(proof="p")))
    moves = (
        (5, Observation(stopped=True)),
        (5.9, Observation()),
        (6, Observation(stopped=True)),
        (6.9, Observation(stopped=True)),
        (7, Observation()),
    )
    life, actions = walk(SPEC, *moves, life=began)
    assert set(actions) == {Action.NONE} and life.state is State.READY and life.stopped_at is None


def test_a_stopped_one_that_is_not_started_again_is_given_up_and_one_that_is_left_alone_lives_on():
    once, left = (replace(SPEC, restart=Restart(), stopped_for_s=limit_s) for limit_s in (1.0, None))
    moves = (
        (0, READY_NEEDS),
        (1, Observation(proof="p")),
        (5, Observation(stopped=True)),
        (7, Observation(stopped=True)),
    )
    life, actions = walk(once, *moves, (7.1, Observation(exit=KILLED)))
    assert life.state is State.FATAL and life.reason == "stopped for 2.0 s, then killed by SIGKILL"
    life, actions = walk(left, *moves, (700, Observation(stopped=True)))
    assert life.state is State.READY and Action.KILL not in actions


def test_what_tells_nothing_for_too_long_is_killed_once_it_is_ready_and_where_that_is_minded():
    minded = replace(SPEC, silent_for_s=5.0)
    moves = (
        (0, READY_NEEDS),
        (1, Observation(silent_s=9.0)),
        (2, Observation(proof="p")),
        (6, Observation(silent_s=4.9)),
        (7, Observation(silent_s=5.2)),
    )
    life, actions = walk(minded, *moves)
    assert actions[-1] is Action.KILL and Action.KILL not in actions[:-1]
    life, _ = walk(minded, (7.1, Observation(exit=KILLED)), life=life)
    assert life.state is State.BACKOFF and life.reason.startswith(
        "sent nothing for 5.2 s, then killed by SIGKILL"
    )
    assert Action.KILL not in walk(SPEC, *moves)[1]


seens = st.builds(
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
walks = st.lists(st.tuples(st.floats(0.0, 20.0), seens), max_size=60)


@given(specs, walks)
def test_whatever_happens_there_is_never_a_second_process_nor_a_signal_to_none(spec, moves):
    life, now = ProcessStatus(), 0.0
    for wait_s, seen in moves:
        now += wait_s
        before, (life, action) = life, step(spec, life, seen, now)
        gone = before.state not in ALIVE or seen.exit is not None
        assert action is not Action.START or gone
        assert action not in (Action.TERMINATE, Action.KILL) or not gone
        assert (life.state in ALIVE) == (
            action is Action.START or (before.state in ALIVE and seen.exit is None)
        )
        assert life.reason
        assert life.state is before.state or life.since == now


@given(specs, walks)
def test_once_starts_are_off_nothing_starts(spec, moves):
    life, now = ProcessStatus(), 0.0
    for i, (wait_s, seen) in enumerate(moves):
        now += wait_s
        off = i >= len(moves) // 2
        life, action = step(spec, life, replace(seen, starts_on=seen.starts_on and not off), now)
        assert not (off and action is Action.START)


@given(specs, st.floats(0.3, 3.0))
def test_what_fails_at_every_start_is_given_up(spec, wait_s):
    life, starts = ProcessStatus(), 0
    for now in (i * wait_s for i in range(30)):
        life, action = step(
            spec, life, Observation(needs_ready=True, exit=FAILED if life.state in ALIVE else None), now
        )
        starts += action is Action.START
    assert life.state in ENDED
    assert starts <= spec.restart.limit
