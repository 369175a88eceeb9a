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
