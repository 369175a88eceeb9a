"""The check of required parameters: read by type, compared, reported; an unknown name is not a lost connection."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.param_check import MAX_PENDING

from .link_rig import ID, Rig, heartbeat

WANTED = {"SYS_HITL": 1, "MPC_XY_P": 0.95, "EKF2_EV_CTRL": 15, "EKF2_MIN_RNG": -7, "MPC_XY_VEL_MAX": 2}
FLOATS = {"MPC_XY_P", "MPC_XY_VEL_MAX"}
LOST = object()


def value_of(name: str, value: float, kind: int | None = None) -> mavlink.MAVLink_message:
    """Return a PARAM_VALUE as PX4 packs it: integers bytewise."""
    kind = kind or (9 if name in FLOATS else 6)
    packed = value if kind == 9 else struct.unpack("<f", struct.pack("<i", int(value)))[0]
    return mavlink.MAVLink_param_value_message(name.encode(), packed, kind, 900, 3)


class Board:
    """A vehicle that holds parameters and, as PX4, does not answer requests for unknown names."""

    def __init__(self, rig: Rig, held: dict[str, float]) -> None:
        self.rig, self.held, self.asked, self.silent = rig, held, [], False

    def run(self, seconds: float) -> None:
        for i in range(round(seconds * 20)):
            self.rig.now += 0.05
            if i % 10 == 0:
                self.rig.receive(heartbeat())
            self.rig.core.tick(self.rig.now)
            for m in self.rig.flush():
                if m.get_type() == "PARAM_REQUEST_READ":
                    self.answer(m)

    def answer(self, m) -> None:
        assert (m.target_system, m.target_component, m.param_index) == (ID, 1, -1)
        assert (m.get_srcSystem(), m.get_srcComponent()) == (ID, 192)
        self.asked.append(m.param_id)
        if m.param_id in self.held and not self.silent:
            self.rig.receive(value_of(m.param_id, self.held[m.param_id]))


def board(held: dict[str, float] | None = None, wanted: dict[str, float] | None = None) -> Board:
    return Board(
        Rig(params=wanted or WANTED, params_file="/runs/x/params/uav7.params"),
        dict(WANTED if held is None else held),
    )


def params_reasons(b: Board) -> list[str]:
    """Return the reasons after those for missing poses and estimates."""
    found = b.rig.reasons()
    return found[found.index("Preflight: battery level unknown") + 1 :]


def test_correct_parameters_are_no_reason_and_reported_once():
    b = board()
    assert params_reasons(b) == ["Preflight: 5 of 5 parameters not read yet"]
    b.run(4.0)
    assert sorted(b.asked) == sorted(WANTED), "each is read once before the first recheck"
    b.run(8.0)
    assert params_reasons(b) == []
    assert b.rig.core.events().count("uav7: all 5 parameters are as required") == 1


@pytest.mark.parametrize(
    ("name", "held", "words"),
    [
        ("SYS_HITL", 0, "Preflight: SYS_HITL is 0, needs 1"),
        ("EKF2_MIN_RNG", -8, "Preflight: EKF2_MIN_RNG is -8, needs -7"),
        ("EKF2_EV_CTRL", 1_090_519_041, "Preflight: EKF2_EV_CTRL is 1090519041, needs 15"),
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


def test_a_float_rounded_to_32_bits_is_equal():
    b = board({**WANTED, "MPC_XY_P": struct.unpack("<f", struct.pack("<f", 0.95))[0] * (1 + 4e-6)})
    b.run(2.0)
    assert params_reasons(b) == []


def test_integers_are_compared_exactly() -> None:
    b = board({"CBRK_FLIGHTTERM": 121211}, {"CBRK_FLIGHTTERM": 121212.0})
    b.run(2.0)
    assert params_reasons(b) == ["Preflight: CBRK_FLIGHTTERM is 121211, needs 121212"]
    b.held["CBRK_FLIGHTTERM"] = 121212
    b.run(7.0)
    assert params_reasons(b) == []


def test_three_differences_are_named_and_the_others_counted():
    wanted = {f"P_{i:02}": i for i in range(15)}
    b = board(dict.fromkeys(wanted, 99), wanted)
    b.run(4.0)
    found = params_reasons(b)
    assert found[:3] == [f"Preflight: P_{i:02} is 99, needs {i}" for i in range(3)]
    assert found[3:] == ["Preflight: ... and 12 more, see params/uav7.params"]
    assert all(len(r.encode()) <= 50 for r in found)


def test_an_unknown_name_differs_from_a_lost_connection():
    held = {k: v for k, v in WANTED.items() if k != "EKF2_EV_CTRL"}
    b = board(held)
    b.run(6.0)
    assert params_reasons(b) == ["Preflight: EKF2_EV_CTRL is unknown to the vehicle"]
    silent = board()
    silent.silent = True
    silent.run(20.0)
    assert params_reasons(silent) == ["Preflight: 5 of 5 parameters not read yet"]
    silent.silent = False
    silent.run(2.0)
    assert params_reasons(silent) == []


def test_a_missing_circuit_breaker_is_not_on() -> None:
    held = {k: v for k, v in WANTED.items() if k != "EKF2_EV_CTRL"}
    b = board(held, {**WANTED, "CBRK_SUPPLY_CHK": 0, "CBRK_FLIGHTTERM": 121212})
    b.run(6.0)
    assert any("CBRK_SUPPLY_CHK is unknown" in reason for reason in params_reasons(b)), (
        "replies may have been lost"
    )
    b.run(9.0)
    assert params_reasons(b) == [
        "Preflight: EKF2_EV_CTRL is unknown to the vehicle",
        "CBRK_FLIGHTTERM is unknown to the vehicle",  # shortened to 50 bytes
    ]


def test_a_param_error_marks_a_name_as_unknown_at_once():
    b = board({k: v for k, v in WANTED.items() if k != "SYS_HITL"})
    b.rig.receive(heartbeat())
    b.rig.receive(mavlink.MAVLink_param_error_message(ID, 192, b"SYS_HITL", -1, 1))
    b.run(0.5)
    assert params_reasons(b) == ["Preflight: SYS_HITL is unknown to the vehicle"]


def test_the_number_of_pending_requests_is_limited():
    wanted = {f"P_{i:02}": i for i in range(60)}
    b = board(wanted, wanted)
    b.rig.receive(heartbeat())
    b.rig.core.tick(b.rig.now)
    assert len([m for m in b.rig.flush() if m.get_type() == "PARAM_REQUEST_READ"]) == MAX_PENDING
    b.run(1.5)
    assert params_reasons(b) == []


def test_wrong_parameters_are_read_again_until_correct():
    b = board({**WANTED, "SYS_HITL": 0})
    b.run(2.0)
    b.held["SYS_HITL"] = 1
    b.run(6.0)
    assert params_reasons(b) == []


def test_a_value_set_by_another_program_counts_at_once():
    b = board()
    b.run(2.0)
    b.rig.receive(value_of("SYS_HITL", 0))
    assert params_reasons(b) == ["Preflight: SYS_HITL is 0, needs 1"]


def test_parameters_are_read_again_after_a_reboot():
    b = board()
    b.rig.receive(mavlink.MAVLink_system_time_message(0, 50_000))
    b.run(2.0)
    b.held["SYS_HITL"] = 0
    b.rig.receive(mavlink.MAVLink_system_time_message(0, 1_000))
    assert params_reasons(b) == ["Preflight: 5 of 5 parameters not read yet"]
    b.run(2.0)
    assert params_reasons(b) == ["Preflight: SYS_HITL is 0, needs 1"]


@pytest.mark.parametrize("number", [5, 60, 150])
def test_right_value_that_changes_is_found_within_30_s(number: int) -> None:
    wanted = {f"P_{i:03}": i for i in range(number)}
    b = board(wanted, wanted)
    b.run(15.0)
    assert params_reasons(b) == []
    b.held = dict.fromkeys(wanted, 999)
    b.run(36.0)  # 30 s, the time to the next recheck, and the time of the replies
    assert f"... and {number - 3} more, see params/uav7.params" in params_reasons(b)[-1]
    assert any(f"{number} of {number} parameters differ" in event for event in b.rig.core.events())


def test_a_recheck_reads_at_most_25_right_values() -> None:
    wanted = {f"P_{i:03}": i for i in range(200)}
    b = board(wanted, wanted)
    b.run(15.0)
    b.asked.clear()
    b.run(20.0)
    assert len(set(b.asked)) == len(b.asked) == 100


def test_known_value_is_kept_while_the_vehicle_does_not_reply() -> None:
    b = board()
    b.run(3.0)
    lost = set(WANTED) - {"SYS_HITL", "MPC_XY_P"}
    b.held = {name: value for name, value in WANTED.items() if name not in lost}
    b.run(60.0)
    assert params_reasons(b) == [], "no reply does not mean that the parameter is unknown"
    b.asked.clear()
    b.run(30.0)
    assert all(5 <= b.asked.count(name) <= 10 for name in lost), (
        "after some requests it waits for the next turn"
    )
    b.held = {**WANTED, "EKF2_EV_CTRL": 0}
    b.run(36.0)
    assert params_reasons(b) == ["Preflight: EKF2_EV_CTRL is 0, needs 15"]


def test_all_parameters_are_read_again_after_preflight_storage() -> None:
    wanted = {f"P_{i:03}": i + 1 for i in range(60)}
    b = board(wanted, wanted)
    b.run(6.0)
    reset = mavlink.MAVLink_command_long_message(
        ID, 1, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 0, 2, 0, 0, 0, 0, 0, 0
    )
    b.asked.clear()
    b.rig.send("router", reset)
    again = ["Preflight: parameters are being read again"]
    assert params_reasons(b) == again, "the vehicle may not arm with values that are perhaps old"
    b.run(3.9)
    assert sorted(b.asked) == sorted(wanted) and params_reasons(b) == again
    b.run(4.0)
    assert params_reasons(b) == []
    b.rig.send("router", reset)
    b.run(1.0)
    b.held = dict.fromkeys(wanted, 0)  # PX4 needs some time to execute the command
    b.run(8.0)
    assert "... and 57 more" in params_reasons(b)[-1]


def test_nothing_is_requested_while_the_vehicle_is_silent():
    rig = Rig(params=WANTED)
    rig.fly(3.0, telemetry=False)
    assert rig.sent("PARAM_REQUEST_READ") == []
