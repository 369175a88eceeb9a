"""Authority over requests that turn a motor or open the shell of the autopilot."""

from __future__ import annotations

import pytest

from arena.authority import Authority, Kind, Request, Role

SPIN, OFFBOARD, HOLD = Request(Kind.SPIN), Request(Kind.MODE, "OFFBOARD"), Request(Kind.MODE, "AUTO.LOITER")
PERSON = Role.GROUND_STATION
TAKEN = "ground station took control: run `arena release`"


def in_offboard(*, simulated: bool = False) -> Authority:
    a = Authority(simulated=simulated)
    assert a.refusal(Role.PROGRAM, OFFBOARD, 0.0) == ""
    a.on_state(True, "OFFBOARD", 0.5)
    return a


def held_by(role: Role) -> Authority:
    """Return the authority over a vehicle that a role has taken from its program with a hold."""
    a = in_offboard()
    assert a.refusal(role, HOLD, 10.0) == ""
    a.on_state(True, "AUTO.LOITER", 10.2)
    return a


def test_shell_and_motor_commands_of_a_program_pass_while_it_flies():
    assert in_offboard().refusal(Role.PROGRAM, SPIN, 10.5) == ""


@pytest.mark.parametrize("role", [Role.PROGRAM, PERSON])
def test_shell_is_refused_while_the_copilot_holds(role):
    """The shell of PX4 can change the mode of an armed vehicle."""
    assert held_by(Role.COPILOT).refusal(role, SPIN, 10.5) == "copilot holds the vehicle"


def test_shell_is_refused_to_a_program_whose_vehicle_was_taken():
    a = held_by(PERSON)
    assert a.refusal(PERSON, SPIN, 10.5) == ""
    assert a.refusal(Role.PROGRAM, SPIN, 10.5) == TAKEN
    a.on_state(False, "AUTO.LOITER", 20.0)
    assert a.refusal(Role.PROGRAM, SPIN, 20.5) == TAKEN
    a.release("ada", 21.0)
    assert a.refusal(Role.PROGRAM, SPIN, 21.5) == ""


FAILURE = Request(Kind.FAILURE)


def flown_by_pilot(*, simulated: bool = False) -> Authority:
    a = in_offboard(simulated=simulated)
    a.on_state(True, "POSCTL", 10.0)
    return a


def landed_by(role: Role, *, simulated: bool = False) -> Authority:
    a = in_offboard(simulated=simulated)
    assert a.refusal(role, Request(Kind.MODE, "AUTO.LAND"), 10.0) == ""
    a.on_state(True, "AUTO.LAND", 10.2)
    return a


@pytest.mark.parametrize("role", [Role.PROGRAM, PERSON])
def test_no_failure_is_injected_while_another_role_has_control(role):
    assert in_offboard().refusal(role, FAILURE, 10.5) == ""
    assert flown_by_pilot().refusal(role, FAILURE, 10.5) == "pilot has control"
    assert (
        landed_by(Role.EMERGENCY).refusal(role, FAILURE, 10.5) == "land-all has control: run `arena release`"
    )
    assert landed_by(Role.COPILOT).refusal(role, FAILURE, 10.5) == "copilot has control: run `arena release`"
    assert held_by(Role.COPILOT).refusal(role, FAILURE, 10.5) == "copilot holds the vehicle"


def test_failures_of_a_simulated_vehicle_are_always_injected():
    for a in (flown_by_pilot(simulated=True), landed_by(Role.EMERGENCY, simulated=True)):
        assert a.refusal(Role.PROGRAM, FAILURE, 10.5) == a.refusal(PERSON, FAILURE, 10.5) == ""
