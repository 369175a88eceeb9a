"""The orders of one vehicle: sent, repeated, obeyed, escalated, latched, and ended by a pilot."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.authority.authority import COPILOT_HOLD_S
from arena.copilot.escalation import MODES, OPEN, RENEW_S, REPEAT_S, Escalation, VehicleStatus
from arena.copilot.fleet_state import Violation
from arena.copilot.settings import STEPS

from .scene import rules

FENCE = Violation(row=0, rule="geofence", why="too far")
LOST = Violation(row=0, rule="pose_age", why="not captured", enough="land")
NEAR = Violation(row=0, rule="separation", why="near", enough="hold")


def helm(**section: Any) -> Escalation:
    return Escalation(name="uav1", rules=rules(**section))


def at(mode: str, *, flying: bool = True, fresh: bool = True) -> VehicleStatus:
    return VehicleStatus(flying=flying, mode=mode, fresh=fresh)


def test_order_has_a_reason_and_is_repeated_until_its_mode_is_reported() -> None:
    h = helm()
    first = h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert first.send == "hold" and first.events == ("uav1: hold: geofence: too far",)
    assert h.decide([FENCE], at("OFFBOARD"), 1.0 + REPEAT_S / 2).send is None
    assert (
        h.decide([], at("OFFBOARD"), 1.0 + REPEAT_S).send == "hold"
    )  # latched, although the violation has ended
    seen = h.decide([], at("AUTO.LOITER"), 1.5)
    assert seen.send is None and "in AUTO.LOITER 0.50 s after the command" in seen.events[0]
    assert h.decide([], at("AUTO.LOITER"), 9.0) == h.decide([], at("AUTO.LOITER"), 99.0)


def test_obeyed_hold_is_renewed_while_the_violation_lasts() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    found = [h.decide([NEAR], at("AUTO.LOITER"), 1.1 + 0.02 * k) for k in range(500)]
    sent = [k * 0.02 for k, d in enumerate(found) if d.send]
    assert all(d.renews and d.send == "hold" for d in found if d.send)
    assert max(b - a for a, b in itertools.pairwise(sent)) < RENEW_S + 0.03 < COPILOT_HOLD_S
    after = [h.decide([], at("AUTO.LOITER"), 11.2 + 0.02 * k).send for k in range(500)]
    assert set(after) == {None}, "the violation has ended: programs may continue"


def test_obeyed_landing_is_not_repeated() -> None:
    h = helm()
    h.decide([LOST], at("OFFBOARD"), 1.0)
    assert {h.decide([LOST], at("AUTO.LAND"), 1.1 + 0.02 * k).send for k in range(500)} == {None}


def test_hold_is_not_renewed_without_telemetry_or_with_a_pilot() -> None:  # review fault 5
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    h.decide([NEAR], at("AUTO.LOITER"), 1.1)
    silent = {h.decide([NEAR], at("AUTO.LOITER", fresh=False), 2.0 + 0.02 * k).send for k in range(500)}
    pilot = {h.decide([NEAR], at("POSCTL"), 20.0 + 0.02 * k).send for k in range(500)}
    assert silent == pilot == {None}


def test_program_that_takes_the_vehicle_is_held_again_while_the_violation_lasts() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([FENCE], at("AUTO.LOITER"), 1.1)
    again = h.decide([FENCE], at("OFFBOARD"), 1.2)
    assert again.send == "hold" and "hold again" in again.events[0]


def test_program_that_takes_the_vehicle_repeatedly_does_not_delay_the_landing() -> None:
    h = helm()
    sent = []
    for k in range(250):  # half a second in OFFBOARD, half a second in hold
        sent.append(h.decide([FENCE], at("AUTO.LOITER" if k // 25 % 2 else "OFFBOARD"), 1.0 + 0.02 * k).send)
    assert "land" in sent and "terminate" not in sent


def test_program_that_takes_the_vehicle_later_is_held_first() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    for k in range(500):
        h.decide([NEAR], at("AUTO.LOITER"), 1.1 + 0.02 * k)
    assert h.decide([NEAR], at("OFFBOARD"), 12.0).send == "hold"


def test_program_may_take_the_vehicle_after_the_violation() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([], at("AUTO.LOITER"), 1.1)
    taken = h.decide([], at("OFFBOARD"), 5.0)
    assert taken.send is None and h.order is None and "the reason for hold has ended" in taken.events[0]


def test_hold_without_effect_escalates_up_to_at_most() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    h.decide([FENCE], at("AUTO.LOITER"), 1.1)
    assert h.decide([FENCE], at("AUTO.LOITER"), 2.9).renews
    assert h.decide([FENCE], at("AUTO.LOITER"), 3.1).send == "land"
    h.decide([FENCE], at("AUTO.LAND"), 3.2)
    assert all(h.decide([FENCE], at("AUTO.LAND"), 4.0 + k).send is None for k in range(20))


def test_landing_without_effect_escalates_to_terminate() -> None:
    h = helm(at_most="terminate")
    sent = [h.decide([FENCE], at("OFFBOARD"), 1.0 + 0.1 * k).send for k in range(60)]
    assert [s for i, s in enumerate(sent) if s and s not in sent[:i]] == list(STEPS)


def test_sufficient_landing_is_not_escalated() -> None:
    h = helm(at_most="terminate")
    h.decide([LOST], at("OFFBOARD"), 1.0)
    assert {h.decide([LOST], at("AUTO.LAND"), 1.0 + k).send for k in range(1, 30)} == {None}


def test_sufficient_hold_is_not_escalated() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    assert all(h.decide([NEAR], at("AUTO.LOITER"), 1.0 + k).renews for k in range(1, 30))


def test_new_violation_starts_its_own_escalation_time() -> None:
    h = helm()
    h.decide([NEAR], at("OFFBOARD"), 1.0)
    h.decide([], at("AUTO.LOITER"), 1.1)
    assert h.decide([FENCE], at("AUTO.LOITER"), 9.0).renews
    assert h.decide([FENCE], at("AUTO.LOITER"), 11.1).send == "land"


def test_silent_vehicle_is_not_escalated() -> None:
    h = helm(at_most="terminate")
    sent = {h.decide([FENCE], at("OFFBOARD", fresh=False), 1.0 + 0.1 * k).send for k in range(200)}
    assert sent == {"hold", None}


def test_hold_is_not_repeated_for_long_to_a_silent_vehicle() -> None:
    """With the router stopped, land-all speaks past it as the copilot does: the vehicle must not be held again and again."""
    h = helm()

    def holds(begin: float, end: float, broken: list[Violation], *, fresh: bool = False) -> int:
        times = [begin + 0.05 * k for k in range(round((end - begin) / 0.05))]
        return sum(h.decide(broken, at("OFFBOARD", fresh=fresh), now).send == "hold" for now in times)

    assert holds(1.0, 3.0, [FENCE]) >= 5
    assert holds(3.1, 60.0, []) == 0 and h.order is not None  # latched all the same
    assert holds(60.0, 62.0, [FENCE]) >= 5  # another reason
    assert holds(62.1, 70.0, [FENCE]) == 0
    assert holds(70.0, 71.0, [], fresh=True) >= 2  # heartbeat received again


@pytest.mark.parametrize("mode", ["ORBIT", "AUTO.FOLLOW_TARGET", "AUTO.PRECLAND", "AUTO.11"])
def test_vehicle_in_any_mode_of_a_computer_is_held(mode: str) -> None:
    """ORBIT is a circle that PX4 flies by itself, AUTO.11 a mode of a ROS 2 node."""
    assert helm().decide([NEAR], at(mode), 1.0).send == "hold"


def test_pilot_ends_an_order() -> None:
    h = helm()
    left = h.decide([FENCE], at("POSCTL"), 1.0)
    assert left.send is None and "not commanded in POSCTL" in left.events[0]
    assert h.decide([FENCE], at("POSCTL"), 1.1).events == ()  # told once
    h.decide([FENCE], at("OFFBOARD"), 2.0)
    taken = h.decide([FENCE], at("POSCTL"), 2.1)
    assert taken.send is None and h.order is None and "by a pilot or a failsafe" in taken.events[0]


def test_landing_by_others_is_not_ended() -> None:
    h = helm(at_most="terminate")
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert {h.decide([FENCE], at("AUTO.LAND"), 1.0 + k).send for k in range(1, 20)} == {None}


def test_order_ends_on_the_ground() -> None:
    h = helm()
    h.decide([FENCE], at("OFFBOARD"), 1.0)
    assert "has ended" in h.decide([FENCE], at("AUTO.LOITER", flying=False), 2.0).events[0]
    assert h.decide([FENCE], at("OFFBOARD", flying=False), 3.0).send is None


BREAKS = st.sampled_from(
    [[], [FENCE], [LOST], [NEAR], [FENCE, LOST], [Violation(row=0, rule="battery", why="low", enough="land")]]
)
MODE = st.sampled_from([*sorted(OPEN), "AUTO.LAND", "AUTO.RTL", "POSCTL", "MANUAL", "TERMINATION", ""])


@given(st.lists(st.tuples(BREAKS, MODE, st.booleans(), st.booleans()), max_size=60), st.sampled_from(STEPS))
def test_order_never_gets_less_severe_and_the_ground_is_never_commanded(
    history: list[tuple[list[Violation], str, bool, bool]], at_most: str
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
