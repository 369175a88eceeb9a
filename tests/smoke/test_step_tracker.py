"""When the triggers of steps come, and which actions are due then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from arena.smoke.language.model import Observation

from .synthetic_flights import (
    flight,
    fly,
)


def test_action_is_due_once_at_its_trigger(referee_for) -> None:
    assert fly(referee_for("  - at: uav1.airborne + 3 s\n    do: kill program uav1\n")) == [
        (4.0, "kill program uav1", False)
    ]


TRIGGERS = {
    "start": 0.0,
    "start + 500 ms": 0.5,
    "then + 2 s": 2.0,
    "uav1.airborne": 1.0,
    "not uav1.airborne": 0.0,
    "uav1.armed": 1.0,
    "uav1.mode == LAND + 1 s": 6.02,
    "uav1.height > 0.5 m": 1.0,
    "uav1.landed + 1 s": 11.0,
    "separation > 0.5 m": 1.0,
    "uav1.touchdown < 1 m/s": 10.0,
    "not uav1.mode == OFFBOARD + 1 s": 1.0,
}


@pytest.mark.parametrize("trigger", TRIGGERS)
def test_trigger_comes_at_its_time(referee_for, trigger: str) -> None:
    ((at, _, _),) = fly(referee_for(f"  - at: {trigger}\n    do: rc loss uav1\n", may=["stay up"]))
    assert at == pytest.approx(TRIGGERS[trigger], abs=1e-9)


def test_trigger_before_its_turn_counts_from_its_own_time(referee_for) -> None:
    steps = "  - at: start + 3 s\n    do: rc loss uav1\n  - at: uav1.airborne + 1 s\n    do: rc loss uav2\n"
    assert [at for at, _, _ in fly(referee_for(steps))] == [3.0, 3.0]


def test_unknown_value_does_not_repeat_a_trigger(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, armed=None if 1.5 < t < 2.0 else t >= 1.0)

    assert fly(referee_for("  - at: uav1.armed + 3 s\n    do: rc loss uav1\n"), script)[0][0] == 4.0


def test_repeated_trigger_counts_from_the_last_time(referee_for) -> None:
    def script(t: float) -> Mapping[str, Any]:
        return flight(t, armed=t >= 1.0 and not 1.5 < t < 2.0)

    assert fly(referee_for("  - at: uav1.armed + 3 s\n    do: rc loss uav1\n"), script)[0][0] == 5.0


def test_then_counts_from_the_last_fulfilled_expectation(referee_for) -> None:
    steps = "  - do: rc loss uav1\n  - expect: uav1.airborne within 5 s\n  - at: then + 1 s\n    do: rc loss uav2\n"
    assert fly(referee_for(steps)) == [(0.0, "rc loss uav1", False), (2.0, "rc loss uav2", False)]


def test_several_actions_keep_their_order(referee_for) -> None:
    steps = "  - at: start\n    do: [rc loss uav1, rc loss uav2]\n  - do: down\n"
    assert [text for _, text, _ in fly(referee_for(steps))] == ["rc loss uav1", "rc loss uav2", "down"]


def test_lasting_action_is_undone_after_its_time(referee_for) -> None:
    steps = "  - at: uav1.airborne\n    do: mocap dropout uav1 for 2 s\n  - at: then + 1 s\n    do: down\n"
    assert fly(referee_for(steps)) == [
        (1.0, "mocap dropout uav1 for 2 s", False),
        (2.0, "down", False),
        (3.0, "mocap dropout uav1 for 2 s", True),
    ]


def test_undo_is_the_same_action(referee_for) -> None:
    referee = referee_for("  - do: link loss 30 % each for 20 ms\n", may=["stay up"])
    (action,) = referee.observe(Observation(time_s=0.0, vehicles={}))
    (undone,) = referee.observe(Observation(time_s=0.02, vehicles={}))
    assert undone == replace(action, undo=True) and not action.undo and action.vehicles == ("uav1", "uav2")


def test_impossible_action_fails_its_step(referee_for) -> None:
    referee = referee_for("  - do: kill router\n    expect: uav1.landed within 20 s\n")
    (action,) = referee.observe(Observation(time_s=0.0, vehicles=flight(0.0)))
    referee.action_failed(action, "no process router")
    assert referee.over
    referee.finish({"failed": ["router: ended with code 1"]})
    failures = [expected for _, expected in referee.verdict().failures]
    assert failures[0] == "kill router could not be done: no process router"
    assert (
        "no process router" not in failures[-1] and "router: ended with code 1" in failures[-1]
    )  # the action did not reach it


def test_impossible_undo_fails_its_step(referee_for) -> None:
    referee = referee_for("  - do: rc loss uav1 for 20 ms\n    expect: uav1.landed within 20 s\n")
    referee.observe(Observation(time_s=0.0, vehicles=flight(0.0)))
    (undo,) = referee.observe(Observation(time_s=0.02, vehicles=flight(0.0)))
    referee.action_failed(undo, "no process receives faults")
    assert (
        referee.over and "could not be undone: no process receives faults" in referee.verdict().failures[0][1]
    )
