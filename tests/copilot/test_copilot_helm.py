"""One vehicle's orders: given, repeated, obeyed, sterner, latched, and whose hand wins."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from arena.copilot.escalation import MODES, OPEN, REPEAT_S, Escalation, Present
from arena.copilot.fleet_state import Broken
from arena.copilot.settings import STEPS

from .scene import rules

FENCE = Broken(row=0, rule="geofence", why="too far")
LOST = Broken(row=0, rule="pose_age", why="not captured", enough="land")
NEAR = Broken(row=0, rule="separation", why="near", enough="hold")


def helm(**section: Any) -> Escalation:
    return Escalation(name="uav1", rules=rules(**section))


def at(mode: str, *, flying: bool = True, fresh: bool = True) -> Present:
    return Present(flying=flying, mode=mode, fresh=fresh)


def test_an_order_has_its_reason_and_is_repeated_until_its_mode_is_seen() -> None:
    h = helm()
    first = h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert first.send == "hold" and first.said == ("uav1: hold: geofence: too far",)
    assert h.decide([FENCE], at("OFFBOARD"), 1.0 + REPEAT_S / 2).send is None
    assert h.decide([], at("OFFBOARD"), 1.0 + REPEAT_S).send == "hold"  # latched, though the reason is gone
    seen = h.decide([], at("AUTO.LOITER"), 1.5)
    assert seen.send is None and "AUTO.LOITER after 0.50 s" in seen.said[0]
    assert h.decide([], at("AUTO.LOITER"), 9.0) == h.decide([], at("AUTO.LOITER"), 99.0)


def test_nothing_is_given_back_and_a_program_that_takes_the_vehicle_is_held_anew_while_the_reason_holds() -> (
    None
):
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([FENCE], at("AUTO.LOITER"), 1.1)
    again = h.decide([FENCE], at("OFFBOARD"), 1.2)
    assert again.send == "hold" and "anew" in again.said[0]


def test_a_program_that_takes_the_vehicle_again_and_again_does_not_put_off_the_landing() -> None:
    h = helm()
    sent = []
    for k in range(250):  # half a second in OFFBOARD, half a second in hold
        sent.append(h.decide([FENCE], at("AUTO.LOITER" if k // 25 % 2 else "OFFBOARD"), 1.0 + 0.02 * k).send)
    assert "land" in sent and "terminate" not in sent


def test_a_program_that_takes_the_vehicle_after_a_while_is_held_first() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    for k in range(500):
        h.decide([NEAR], at("AUTO.LOITER"), 1.1 + 0.02 * k)
    assert h.decide([NEAR], at("OFFBOARD"), 12.0).send == "hold"


def test_a_program_that_takes_the_vehicle_when_the_reason_is_gone_has_it() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([], at("AUTO.LOITER"), 1.1)
    taken = h.decide([], at("OFFBOARD"), 5.0)
    assert taken.send is None and h.order is None and "the reason to hold is gone" in taken.said[0]


def test_a_hold_that_does_not_help_becomes_a_landing_and_no_more_than_at_most() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([FENCE], at("AUTO.LOITER"), 1.1)
    assert h.decide([FENCE], at("AUTO.LOITER"), 2.9).send is None
    assert h.decide([FENCE], at("AUTO.LOITER"), 3.1).send == "land"
    h.decide([FENCE], at("AUTO.LAND"), 3.2)
    assert all(h.decide([FENCE], at("AUTO.LAND"), 4.0 + k).send is None for k in range(20))


def test_with_terminate_allowed_a_landing_that_does_not_help_is_one() -> None:
    h = helm(at_most="terminate")
    sent = [h.decide([FENCE], at("OFFBOARD"), 1.0 + 0.1 * k).send for k in range(60)]
    assert [s for i, s in enumerate(sent) if s and s not in sent[:i]] == list(STEPS)


def test_what_a_landing_answers_is_not_answered_by_more() -> None:
    h = helm(at_most="terminate")
    h.decide([LOST], at("OFFBOARD"), 1.0)
    assert {h.decide([LOST], at("AUTO.LAND"), 1.0 + k).send for k in range(1, 30)} == {None}


def test_one_that_holds_while_the_other_is_still_far_is_left_holding() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    assert {h.decide([NEAR], at("AUTO.LOITER"), 1.0 + k).send for k in range(1, 30)} == {None}


def test_a_reason_that_has_just_come_is_not_taken_for_one_that_has_lasted() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    h.decide([], at("AUTO.LOITER"), 1.1)
    assert h.decide([FENCE], at("AUTO.LOITER"), 9.0).send is None
    assert h.decide([FENCE], at("AUTO.LOITER"), 11.1).send == "land"


def test_silence_is_not_disobedience() -> None:
    h = helm(at_most="terminate")
    sent = {h.decide([FENCE], at("OFFBOARD", fresh=False), 1.0 + 0.1 * k).send for k in range(200)}
    assert sent == {"hold", None}


def test_a_hold_that_nobody_answers_does_not_stand_against_a_landing() -> None:
    """With the router stopped, land-all speaks past it as the copilot does: the vehicle must not be held again and again."""
    h = helm()

    def holds(begin: float, end: float, broken: list[Broken], *, fresh: bool = False) -> int:
        times = [begin + 0.05 * k for k in range(round((end - begin) / 0.05))]
        return sum(h.decide(broken, at("OFFBOARD", fresh=fresh), now).send == "hold" for now in times)

    assert holds(1.0, 3.0, [FENCE]) >= 5
    assert holds(3.1, 60.0, []) == 0 and h.order is not None  # latched all the same
    assert holds(60.0, 62.0, [FENCE]) >= 5  # another reason
    assert holds(62.1, 70.0, [FENCE]) == 0
    assert holds(70.0, 71.0, [], fresh=True) >= 2  # heard again


def test_the_pilot_wins() -> None:
    h = helm()
    left = h.decide([FENCE], at("POSCTL"), 1.0)
    assert left.send is None and "in POSCTL it is left alone" in left.said[0]
    assert h.decide([FENCE], at("POSCTL"), 1.1).said == ()  # told once
    h.decide([FENCE], at("OFFBOARD"), 2.0)
    taken = h.decide([FENCE], at("POSCTL"), 2.1)
    assert taken.send is None and h.order is None and "by another hand" in taken.said[0]


def test_a_landing_by_another_hand_is_left_alone() -> None:
    h = helm(at_most="terminate")
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert {h.decide([FENCE], at("AUTO.LAND"), 1.0 + k).send for k in range(1, 20)} == {None}


def test_on_the_ground_an_order_ends_and_none_is_given() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert "has ended" in h.decide([FENCE], at("AUTO.LOITER", flying=False), 2.0).said[0]
    assert h.decide([FENCE], at("OFFBOARD", flying=False), 3.0).send is None


BREAKS = st.sampled_from(
    [[], [FENCE], [LOST], [NEAR], [FENCE, LOST], [Broken(row=0, rule="battery", why="low", enough="land")]]
)
MODE = st.sampled_from([*sorted(OPEN), "AUTO.LAND", "AUTO.RTL", "POSCTL", "MANUAL", "TERMINATION", ""])


@given(st.lists(st.tuples(BREAKS, MODE, st.booleans(), st.booleans()), max_size=60), st.sampled_from(STEPS))
def test_whatever_happens_an_order_never_grows_milder_while_it_stands_and_the_ground_is_never_commanded(
    history: list[tuple[list[Broken], str, bool, bool]], at_most: str
) -> None:
    section = {"at_most": at_most}
    if at_most == "hold":
        each = ("tilt", "pose_age", "estimate", "battery", "program")
        section |= {rule: {"do": "hold"} for rule in each}  # type: ignore[misc]
    h, last = helm(**section), -1
    for k, (broken, mode, flying, fresh) in enumerate(history):
        had = h.order
        acts = h.decide(broken, at(mode, flying=flying, fresh=fresh), 0.5 * k)
        rank = -1 if h.order is None else STEPS.index(h.order.step)
        assert had is None or h.order is None or rank >= last
        assert rank <= STEPS.index(at_most)
        if acts.send is not None:
            assert flying and h.order is not None and acts.send == h.order.step
            assert mode in OPEN or mode == MODES["land"]
        last = rank
