"""Tests of the parameters generated from requirements, for every PX4 version."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import pytest

from arena.constants import GRAVITY_M_S2
from arena.params.facts.parameter_table import parameters, versions
from arena.params.generation.generate import Generated, generate
from arena.params.generation.requirements import Failsafe, FenceCylinder, Requirements, Rotor
from arena.plan.firmware import requirements_failsafe
from arena.schema.failsafe import Failsafe as FailsafeKeys

VERSIONS = [str(v) for v in versions()]
ROTORS = tuple(
    Rotor(x_m=x, y_m=y, spin=s)
    for x, y, s in ((0.1, 0.2, 1), (-0.1, -0.2, 1), (0.1, -0.2, -1), (-0.1, 0.2, -1))
)


def failsafe(**changes: object) -> Failsafe:
    """Return the failsafe of an arena that configures none, with these changes."""
    defaults = requirements_failsafe(FailsafeKeys(), has_sticks=False)
    return dataclasses.replace(defaults, **changes)  # type: ignore[arg-type]


def made(version: str, **changes: object) -> Generated:
    given = {
        "system_id": 3,
        "hover": 0.5,
        "vision_delay_ms": 11.0,
        "ceiling_m": 3.0,
        "failsafe": failsafe(),
        "rotors": ROTORS,
        "moment_ratio_m": 0.05,
        "gains": {"MC_ROLL_P": 6.0, "MPC_XY_VEL_P_ACC": 1.8},
    }
    return generate(Requirements(**{**given, **changes}), version)  # type: ignore[arg-type]


def test_same_requirements_have_other_names_in_1_9_and_1_16() -> None:
    then, now = made("1.9").values, made("1.16").values
    assert then["COM_POSCTL_NAVL"] == 1
    assert (then["EKF2_AID_MASK"], then["EKF2_HGT_MODE"], then["COM_OBL_ACT"], then["COM_OBL_RC_ACT"]) == (
        24,
        3,
        0,
        4,
    )
    assert then["MPC_XY_VEL_P"] == pytest.approx(1.8 * 0.5 / GRAVITY_M_S2)
    assert (now["EKF2_EV_CTRL"], now["EKF2_HGT_REF"], now["COM_OBL_RC_ACT"], now["MPC_XY_VEL_P_ACC"]) == (
        15,
        3,
        4,
        1.8,
    )
    assert then["COM_OF_LOSS_T"] == 0.5 and now["COM_OF_LOSS_T"] == 1.0, "1.9 adds 0.5 s itself"
    assert {"EKF2_AID_MASK", "COM_OBL_ACT"}.isdisjoint(now)
    assert {"EKF2_EV_CTRL", "MPC_XY_VEL_P_ACC", "COM_FAIL_ACT_T"}.isdisjoint(then)


COMBINED = {
    "offboard_loss": ("land", "hold", "return", "terminate", "disarm"),
    "position_loss": ("land", "terminate"),
    "rc_loss": ("none", "land", "return"),
}
"""Failsafes that share parameters: every combination is generated."""
INDEPENDENT = {
    "data_link_loss": ("none", "hold", "land"),
    "attitude": (None, "none", "terminate"),
    "actions": tuple({"geofence": action} for action in ("none", "land", "terminate")),
}
"""Failsafes with parameters of their own: every value is generated, in turn."""


def failsafes(**fixed: object) -> Iterator[Failsafe]:
    """Yield every combination of COMBINED, with the values of INDEPENDENT in turn."""
    turns = itertools.cycle(zip(*INDEPENDENT.values(), strict=True))
    for chosen, others in zip(itertools.product(*COMBINED.values()), turns, strict=False):
        combined, independent = zip(COMBINED, chosen, strict=True), zip(INDEPENDENT, others, strict=True)
        yield failsafe(**dict(combined), **dict(independent), **fixed)


@pytest.mark.parametrize("version", VERSIONS)
def test_every_line_is_within_the_limits_of_its_version(version: str) -> None:
    known = parameters(version)
    for gps, rc in ((False, False), (True, True)):
        for chosen in failsafes(low_battery_land=None if gps else 0.1):
            for line in made(version, failsafe=chosen, gps=gps, sticks=rc, landing_speed_m_s=0.7).lines:
                limits = known[line.name]
                assert limits.type == "FLOAT" or float(line.value).is_integer(), line
                assert limits.min is None or line.value >= limits.min - 1e-9, line
                assert limits.max is None or line.value <= limits.max + 1e-9, line
                assert line.meaning and line.reason


def test_requirements_without_a_parameter_are_not_possible() -> None:
    assert any(
        "geofence" in words and "land was added in 1.11" in words for words in made("1.9").not_possible
    )
    assert (
        any("mixer file" in words for words in made("1.12").not_possible)
        and made("1.13", ceiling_m=10.0).not_possible == ()
    )
    terminate = made("1.16", failsafe=failsafe(position_loss="terminate"))
    assert [words.split(":")[0] for words in terminate.not_possible] == ["failsafe.position_loss"]
    assert (
        made("1.16", failsafe=failsafe(offboard_loss="terminate", position_loss="terminate")).not_possible
        == ()
    )
    assert [
        w for w in made("1.9", gains={"MPC_JERK_NEW": 1.0, "MPC_JERK_MAX": 2.0}).not_possible if "JERK" in w
    ] == ["gains: PX4 1.9 has no MPC_JERK_NEW (1)"]
    assert made("1.16", failsafe=failsafe(rc_loss="land")).not_possible == (
        "failsafe.rc_loss: land is not set, because the vehicle has no RC. Set `sticks: true` if it has (hardware: `radio: required`)",
    )
    no_ground_station = failsafe(data_link_loss="terminate")
    assert made("1.13", failsafe=no_ground_station).values["NAV_DLL_ACT"] == 5, (
        "a termination is final since 1.14"
    )
    assert made("1.16", failsafe=no_ground_station).values["NAV_DLL_ACT"] == 0
    assert [words.split(":")[0] for words in made("1.16", failsafe=no_ground_station).not_possible] == [
        "failsafe.data_link_loss"
    ]
    soon = failsafe(data_link_loss="land", data_link_loss_after_s=2)
    assert any(
        "COM_DL_LOSS_T -0.5, which is outside the limits of PX4 1.16; 5 is set instead" in words
        for words in made("1.16", failsafe=soon).not_possible
    )
    assert any("RTL_DESCEND_ALT" in words for words in made("1.9").not_possible), (
        "the room is lower than the least RTL_DESCEND_ALT"
    )


def test_users_parameters_win_and_keep_their_reason() -> None:
    own = made(
        "1.16", own={"COM_OF_LOSS_T": 0.4, "NO_SUCH": 1.0}, reasons={"own.COM_OF_LOSS_T": "arena.yaml:7"}
    )
    line = {each.name: each for each in own.lines}["COM_OF_LOSS_T"]
    assert (line.value, line.reason) == (0.4, "arena.yaml:7")
    assert any("NO_SUCH" in words for words in own.not_possible) and own.values["NO_SUCH"] == 1.0


def test_attitude_failsafe_is_set_only_when_configured() -> None:
    names = {"CBRK_FLIGHTTERM", "FD_FAIL_R", "FD_FAIL_P"}
    for version in VERSIONS:
        assert names.isdisjoint(made(version).values)
        assert made(version, failsafe=failsafe(attitude="none")).values["CBRK_FLIGHTTERM"] == 121212
    armed = made("1.16", failsafe=failsafe(attitude="terminate", attitude_above_deg=75)).values
    assert {name: armed[name] for name in names} == {"CBRK_FLIGHTTERM": 0, "FD_FAIL_R": 75, "FD_FAIL_P": 75}
    then = made("1.9", failsafe=failsafe(attitude="terminate"))
    assert "CBRK_FLIGHTTERM" not in then.values and any(
        "v1.9 documents a failsafe here" in words for words in then.not_possible
    )
    narrow = made("1.12", failsafe=failsafe(attitude="terminate", attitude_above_deg=50))
    assert narrow.values["FD_FAIL_R"] == 60 and any(
        "FD_FAIL_R 50, which is outside the limits of PX4 1.12" in w for w in narrow.not_possible
    )


def test_no_reaction_to_rc_loss_covers_every_mode() -> None:
    for version in VERSIONS:
        values = made(version, sticks=True, failsafe=failsafe(rc_loss="none")).values
        assert values.get("COM_RCL_EXCEPT") == 7 or values.get("NAV_RCL_ACT") == 0, version


def test_without_poses_no_ekf2_parameter_is_set() -> None:
    assert not [name for name in made("1.16", vision_delay_ms=None).values if name.startswith("EKF2")]


def test_event_of_the_table_needs_no_code_of_its_own() -> None:
    motor = failsafe(actions={"motor_failure": "land"})
    line = next(each for each in made("1.16", failsafe=motor).lines if each.name == "COM_ACT_FAIL_ACT")
    assert (line.value, line.meaning) == (2, "land when a motor fails")
    assert any(
        "COM_ACT_FAIL_ACT was added in 1.14" in text for text in made("1.13", failsafe=motor).not_possible
    )


OF_REAL_VEHICLES = {"CBRK_SUPPLY_CHK": 0, "COM_RC_LOSS_T": 0.5, "RTL_LAND_DELAY": 0, "GF_SOURCE": 0}
FENCE = FenceCylinder(radius_m=4.0, height_m=2.5)


@pytest.mark.parametrize("version", VERSIONS)
def test_real_vehicles_must_have_the_defaults_that_failsafes_need(version: str) -> None:
    wanted = failsafe(rc_loss="land", actions={"geofence": "return"})
    given = {"failsafe": wanted, "sticks": True, "fence": FENCE}
    real = made(version, simulated=False, **given).values
    assert {name: real[name] for name in OF_REAL_VEHICLES} == OF_REAL_VEHICLES
    assert not set(OF_REAL_VEHICLES) & set(made(version, simulated=True, **given).values)


@pytest.mark.parametrize("version", VERSIONS)
def test_real_vehicles_keep_values_that_no_failsafe_needs(version: str) -> None:
    without = failsafe(low_battery_land=None, rc_loss="none", actions={"geofence": "land"})
    assert not set(OF_REAL_VEHICLES) & set(
        made(version, simulated=False, sticks=True, failsafe=without).values
    )
    no_radio = failsafe(rc_loss="land", offboard_loss="return")
    assert set(OF_REAL_VEHICLES) & set(made(version, simulated=False, failsafe=no_radio).values) == {
        "CBRK_SUPPLY_CHK",
        "RTL_LAND_DELAY",
    }


def test_own_value_of_a_circuit_breaker_wins() -> None:
    own = made("1.16", simulated=False, own={"CBRK_SUPPLY_CHK": 894281.0})
    assert own.values["CBRK_SUPPLY_CHK"] == 894281
