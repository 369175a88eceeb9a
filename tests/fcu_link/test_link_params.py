"""The parameters that must hold: read by type, compared, told; a name that does not exist is not a lost link."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.param_check import WINDOW

from .parts import ID, Rig, heartbeat

WANTED = {"SYS_HITL": 1, "MPC_XY_P": 0.95, "EKF2_EV_CTRL": 15, "EKF2_MIN_RNG": -7, "MPC_XY_VEL_MAX": 2}
FLOATS = {"MPC_XY_P", "MPC_XY_VEL_MAX"}
LOST = object()


def value_of(name: str, value: float, kind: int | None = None) -> mavlink.MAVLink_message:
    """PARAM_VALUE as PX4 packs it: integers bytewise."""
    kind = kind or (9 if name in FLOATS else 6)
    packed = value if kind == 9 else struct.unpack("<f", struct.pack("<i", int(value)))[0]
    return mavlink.MAVLink_param_value_message(name.encode(), packed, kind, 900, 3)


class Board:
    """A vehicle that holds parameters and answers as PX4 does: with silence to a name that it does not know."""

    def __init__(self, rig: Rig, held: dict[str, float]) -> None:
        self.rig, self.held, self.asked, self.deaf = rig, held, [], False

    def run(self, seconds: float) -> None:
        for i in range(round(seconds * 20)):
            self.rig.now += 0.05
            if i % 10 == 0:
                self.rig.say(heartbeat())
            self.rig.core.tick(self.rig.now)
            for m in self.rig.flush():
                if m.get_type() == "PARAM_REQUEST_READ":
                    self.answer(m)

    def answer(self, m) -> None:
        assert (m.target_system, m.target_component, m.param_index) == (ID, 1, -1)
        assert (m.get_srcSystem(), m.get_srcComponent()) == (ID, 192)
        self.asked.append(m.param_id)
        if m.param_id in self.held and not self.deaf:
            self.rig.say(value_of(m.param_id, self.held[m.param_id]))


def board(held: dict[str, float] | None = None, wanted: dict[str, float] | None = None) -> Board:
    return Board(
        Rig(params=wanted or WANTED, params_file="/runs/x/params/uav7.params"),
        dict(WANTED if held is None else held),
    )


def params_reasons(b: Board) -> list[str]:
    """The others, of a vehicle without poses and an estimate, stand before them."""
    found = b.rig.reasons()
    return found[found.index("Preflight: battery level unknown") + 1 :]


def test_parameters_that_hold_are_no_reason_and_are_told_once():
    b = board()
    assert params_reasons(b) == ["Preflight: 5 of 5 parameters not read yet"]
    b.run(12.0)
    assert params_reasons(b) == []
    assert b.rig.core.events().count("uav7: all 5 parameters hold") == 1
    assert sorted(b.asked) == sorted(WANTED), "each is read once"


@pytest.mark.parametrize(
    ("name", "held", "words"),
    [
        ("SYS_HITL", 0, "Preflight: SYS_HITL is 0, needs 1"),
        ("EKF2_MIN_RNG", -8, "Preflight: EKF2_MIN_RNG is -8, needs -7"),
        ("EKF2_EV_CTRL", 1_090_519_041, "Preflight: EKF2_EV_CTRL is 1.09052e+09, needs 15"),
        ("MPC_XY_P", 0.9501, "Preflight: MPC_XY_P is 0.9501, needs 0.95"),
    ],
)
def test_a_difference_is_a_reason_with_both_values(name, held, words):
    b = board({**WANTED, name: held})
    b.run(2.0)
    assert params_reasons(b) == [words]
    assert any(
        words.removeprefix("Preflight: ") in e and "params/uav7.params" in e for e in b.rig.core.events()
    )


def test_a_float_that_went_through_32_bits_holds():
    b = board({**WANTED, "MPC_XY_P": struct.unpack("<f", struct.pack("<f", 0.95))[0] * (1 + 4e-6)})
    b.run(2.0)
    assert params_reasons(b) == []


def test_of_many_differences_three_are_named_and_the_rest_counted():
    wanted = {f"P_{i:02}": i for i in range(15)}
    b = board(dict.fromkeys(wanted, 99), wanted)
    b.run(4.0)
    found = params_reasons(b)
    assert found[:3] == [f"Preflight: P_{i:02} is 99, needs {i}" for i in range(3)]
    assert found[3:] == ["Preflight: ... and 12 more, see params/uav7.params"]
    assert all(len(r.encode()) <= 50 for r in found)


def test_a_name_that_the_vehicle_does_not_know_is_told_apart_from_a_lost_link():
    held = {k: v for k, v in WANTED.items() if k != "EKF2_EV_CTRL"}
    b = board(held)
    b.run(6.0)
    assert params_reasons(b) == ["Preflight: EKF2_EV_CTRL is unknown to the vehicle"]
    deaf = board()
    deaf.deaf = True
    deaf.run(20.0)
    assert params_reasons(deaf) == ["Preflight: 5 of 5 parameters not read yet"]
    deaf.deaf = False
    deaf.run(2.0)
    assert params_reasons(deaf) == []


def test_an_autopilot_that_answers_unknown_names_is_believed_at_once():
    b = board({k: v for k, v in WANTED.items() if k != "SYS_HITL"})
    b.rig.say(heartbeat())
    b.rig.say(mavlink.MAVLink_param_error_message(ID, 192, b"SYS_HITL", -1, 1))
    b.run(0.5)
    assert params_reasons(b) == ["Preflight: SYS_HITL is unknown to the vehicle"]


def test_few_are_under_way_at_once():
    wanted = {f"P_{i:02}": i for i in range(60)}
    b = board(wanted, wanted)
    b.rig.say(heartbeat())
    b.rig.core.tick(b.rig.now)
    assert len([m for m in b.rig.flush() if m.get_type() == "PARAM_REQUEST_READ"]) == WINDOW
    b.run(1.5)
    assert params_reasons(b) == []


def test_wrong_ones_are_read_again_until_they_are_right():
    b = board({**WANTED, "SYS_HITL": 0})
    b.run(2.0)
    b.held["SYS_HITL"] = 1
    b.run(6.0)
    assert params_reasons(b) == []


def test_a_value_that_somebody_sets_is_seen_at_once():
    b = board()
    b.run(2.0)
    b.rig.say(value_of("SYS_HITL", 0))
    assert params_reasons(b) == ["Preflight: SYS_HITL is 0, needs 1"]


def test_after_a_reboot_all_are_read_again():
    b = board()
    b.rig.say(mavlink.MAVLink_system_time_message(0, 50_000))
    b.run(2.0)
    b.held["SYS_HITL"] = 0
    b.run(8.0)
    assert params_reasons(b) == [], "right ones are not read again and again"
    b.rig.say(mavlink.MAVLink_system_time_message(0, 1_000))
    assert params_reasons(b) == ["Preflight: 5 of 5 parameters not read yet"]
    b.run(2.0)
    assert params_reasons(b) == ["Preflight: SYS_HITL is 0, needs 1"]


def test_nothing_is_asked_while_the_vehicle_is_not_heard():
    rig = Rig(params=WANTED)
    rig.fly(3.0, telemetry=False)
    assert rig.sent("PARAM_REQUEST_READ") == []
