"""The PX4 parameters that the plan asks for, by arena, vehicle and PX4 version."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from arena.cli._params import required_parameters
from arena.errors import InputError
from arena.params.facts.parameter_table import parameters, versions
from arena.plan import make_plan
from arena.plan.checks import check_arena
from arena.plan.firmware import (
    firmware,
    left_out_names,
    origins,
    px4_version,
    unmeasured,
    written_param_findings,
)
from arena.plan.resolved_yaml import arena_yaml
from arena.schema import Arena, load_arena

VEHICLES = (
    "vehicles:\n  uav1: {autopilot: builtin}\n"
    "  uav2: {autopilot: builtin, profile: intel_aero, start: {position: [-2, 1, -0.5]}}\n"
)
NATNET = "mocap: {source: natnet, server: 10.0.0.2}\n"
HARDWARE = "{autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14580'"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(text: str, *overrides: str) -> Arena:
    Path("arena.yaml").write_text(text)
    return load_arena("arena.yaml", overrides)


def values(arena: Arena, name: str = "uav1", version: str = "") -> dict[str, float]:
    return firmware(arena, arena.vehicle(name), version).values


def test_parameters_follow_the_arena_and_the_profile() -> None:
    arena = load(VEHICLES, "mocap.latency_ms=20", "vehicles.uav2.forward=false")
    one, two = values(arena), values(arena, "uav2")
    assert one["EKF2_EV_DELAY"] == 21.0 and one["EKF2_EV_CTRL"] == 15.0 and "EKF2_EV_DELAY" not in two
    assert one["MPC_THR_HOVER"] == pytest.approx(0.5652, abs=1e-4)
    assert two["MPC_THR_HOVER"] == pytest.approx(0.6099, abs=1e-4)
    assert (one["MAV_SYS_ID"], two["MAV_SYS_ID"]) == (1.0, 2.0)


def test_offboard_loss_lands_by_default() -> None:
    assert values(load(VEHICLES))["COM_OBL_RC_ACT"] == 4.0


def test_return_height_stays_under_the_ceiling() -> None:
    low, high = values(load(VEHICLES)), values(load(VEHICLES, "world.size=[30,30,40]"))
    assert (low["RTL_RETURN_ALT"], low["RTL_DESCEND_ALT"]) == (pytest.approx(1.8), pytest.approx(1.8))
    assert (high["RTL_RETURN_ALT"], high["RTL_DESCEND_ALT"]) == (24.0, 10.0)


def test_parameter_of_the_user_replaces_the_generated_one() -> None:
    assert values(load(VEHICLES, "defaults.params.MPC_THR_HOVER=0.4"))["MPC_THR_HOVER"] == 0.4


def test_every_parameter_has_an_origin() -> None:
    arena = load("failsafe:\n  offboard_loss: {after_s: 2}\n" + VEHICLES, "vehicles.uav1.params.MPC_XY_P=0.9")
    found = {key: origin.source for key, origin in origins(arena).items() if ".uav1." in key}
    assert found["vehicles.uav1.params.COM_OF_LOSS_T"] == "arena.yaml:2"
    assert found["vehicles.uav1.params.MPC_XY_P"] == "--set"
    assert found["vehicles.uav1.params.MC_ROLLRATE_P"] == "profile iris"
    assert found["vehicles.uav1.params.MAV_SYS_ID"] == "rule: id"
    assert set(values(arena)) == {key.rpartition(".")[2] for key in found} - {"px4_version"}


def test_resolved_yaml_gives_the_same_parameters() -> None:
    arena = load("geofence: {north: [-3, 2], margin_m: 0.25}\n" + VEHICLES)
    again = load(arena_yaml(arena))
    assert again.geofence == arena.geofence
    assert all(values(again, v.name) == values(arena, v.name) for v in arena.vehicles)


def test_fence_cylinder_holds_the_whole_box_and_no_more() -> None:
    arena = load("geofence: {north: [-3, 2], up: 2.5}\n" + VEHICLES)
    assert arena.geofence is not None
    for v in arena.vehicles:
        (n, e, d), made = v.position, values(arena, v.name)
        corners = [math.dist((n, e), (x, y)) for x in arena.geofence.north for y in arena.geofence.east]
        assert max(corners) <= made["GF_MAX_HOR_DIST"] < max(corners) + 0.002
        centre = v.profile.ground_clearance_m - d
        assert made["GF_MAX_VER_DIST"] == pytest.approx(2.5 - centre, abs=0.001)
        assert made["GF_ACTION"] == 5
        assert 0 < made["RTL_RETURN_ALT"] < made["GF_MAX_VER_DIST"]
        assert 0 < made["MIS_TAKEOFF_ALT"] < made["GF_MAX_VER_DIST"]
        assert origins(arena)[f"vehicles.{v.name}.params.GF_MAX_VER_DIST"].source == "arena.yaml:1"


def test_geofence_adds_parameters_and_changes_only_the_return_heights() -> None:
    fenced, free = load("geofence: {}\n" + VEHICLES), load(VEHICLES)
    for v in free.vehicles:
        with_fence, without = values(fenced, v.name), values(free, v.name)
        assert {"GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "MIS_TAKEOFF_ALT"}.isdisjoint(without)
        assert {k: x for k, x in without.items() if "RTL" not in k}.items() <= with_fence.items()


@pytest.mark.parametrize("version", [str(v) for v in versions()])
def test_fence_is_within_the_limits_of_every_version(version: str) -> None:
    made, known = values(load("geofence: {up: 2}\n" + VEHICLES), version=version), parameters(version)
    for name in ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "MIS_TAKEOFF_ALT"):
        low, high = known[name].min, known[name].max
        assert known[name].type == "FLOAT"
        assert (low is None or made[name] >= low) and (high is None or made[name] <= high)


def test_hardware_may_start_anywhere_in_the_fence() -> None:
    made = values(load(f"{NATNET}geofence: {{}}\nvehicles:\n  uav1: {HARDWARE}}}\n"))
    assert made["GF_MAX_HOR_DIST"] == pytest.approx(math.hypot(7, 4), abs=0.001)


def test_vehicle_without_poses_gets_no_fence_and_a_sentence() -> None:
    arena = load("geofence: {}\nvehicles:\n  uav1: {autopilot: builtin, forward: false}\n")
    made = firmware(arena, arena.vehicles[0])
    assert "GF_MAX_HOR_DIST" not in made.values
    assert any("geofence: " in words and "no home" in words for words in made.not_possible)


def test_declination_is_that_of_the_magnetic_field_at_the_origin() -> None:
    arena = load(
        "world: {origin: {lat_deg: 38.7, lon_deg: -9.1, alt_m: 100}}\n"
        "px4: {home: stand-in}\n"
        "defaults: {autopilot: px4, gps: true}\n"
        "vehicles:\n  uav1: {forward: false}\n  uav2: {start: {position: [2, 0, 0]}}\n"
    )
    assert values(arena)["EKF2_MAG_DECL"] == pytest.approx(-1.15)
    assert "EKF2_MAG_DECL" not in values(arena, "uav2"), "the heading comes from poses"


def test_rotor_geometry_is_left_to_hardware_and_to_the_builtin_autopilot() -> None:
    text = f"{NATNET}vehicles:\n  uav1: {HARDWARE}, px4_version: '1.14'}}\n  uav2: {{autopilot: builtin}}\n"
    arena = load(text)
    assert "CA_ROTOR_COUNT" not in values(arena) | values(arena, "uav2")
    assert firmware(arena, arena.vehicles[0]).version == "1.14"


def test_preflight_params_false_limits_the_check_only() -> None:
    arena = load(
        f"{NATNET}preflight: {{params: false}}\nvehicles:\n  uav1: {HARDWARE}, params: {{MPC_XY_P: 0.9}}}}\n"
    )
    assert required_parameters(arena, arena.vehicles[0], "").values["COM_OBL_RC_ACT"] == 4.0
    assert values(arena)["COM_OBL_RC_ACT"] == 4.0, "`arena params push` writes all required parameters"
    plan = make_plan(arena)
    assert plan.slices["link.uav1.json"]["params"] == {"MPC_XY_P": 0.9}
    again = make_plan(load(plan.yaml))
    assert again.slices["link.uav1.json"]["params"] == {"MPC_XY_P": 0.9}


@pytest.mark.parametrize("version", ["1.13", "1.14", "1.15", "1.16", "1.17", "1.18"])
def test_battery_failsafe_of_hardware_is_on_again_after_hitl(version: str) -> None:
    hitl = "{autopilot: hitl, serial: /dev/ttyACM0, px4_version: '" + version + "'}"
    arena = load(
        f"{NATNET}vehicles:\n  uav1: {HARDWARE}, px4_version: '{version}'}}\n  uav2: {hitl}\n"
        f"  uav3: {HARDWARE.replace('14580', '14581')}, params: {{CBRK_SUPPLY_CHK: 894281}}}}\n"
    )
    links = {name: firmware(arena, arena.vehicle(name)).values for name in ("uav1", "uav2", "uav3")}
    assert links["uav1"]["CBRK_SUPPLY_CHK"] == 0 and links["uav3"]["CBRK_SUPPLY_CHK"] == 894281
    assert "CBRK_SUPPLY_CHK" not in links["uav2"]
    slices = make_plan(arena).slices
    assert [slices[f"link.uav{k}.json"]["params"]["CBRK_SUPPLY_CHK"] for k in (1, 2, 3)] == [
        0,
        894281,
        894281,
    ]


OF_ONE_VEHICLE = "CAL_ACC0_XOFF 0.1\nSENS_BOARD_X_OFF 2\nLND_FLIGHT_T_LO 77\nRC1_TRIM 1490\n"


def test_shared_params_file_gives_no_calibrations_of_one_vehicle(folder: Path) -> None:
    (folder / "tuned.params").write_text(OF_ONE_VEHICLE + "MPC_XY_P 0.9\n")
    text = (
        f"{NATNET}defaults: {{params_file: tuned.params}}\nvehicles:\n  uav1: {HARDWARE}, params: {{RC1_TRIM: 1500}}}}\n"
        f"  uav2: {HARDWARE.replace('14580', '14581')}, params_file: tuned.params}}\n"
    )
    arena = load(text)
    one, two = values(arena), values(arena, "uav2")
    assert one["MPC_XY_P"] == two["MPC_XY_P"] == 0.9
    assert one["RC1_TRIM"] == 1500.0, "a value of the YAML itself is used"
    assert not {"CAL_ACC0_XOFF", "SENS_BOARD_X_OFF", "LND_FLIGHT_T_LO"} & set(one)
    assert left_out_names(arena, arena.vehicle("uav1")) == [
        "CAL_ACC0_XOFF",
        "SENS_BOARD_X_OFF",
        "LND_FLIGHT_T_LO",
    ]
    by_itself = ["CAL_ACC0_XOFF", "LND_FLIGHT_T_LO"]
    assert left_out_names(arena, arena.vehicle("uav2")) == by_itself, "PX4 changes them in flight"
    assert "SENS_BOARD_X_OFF" in two and not set(by_itself) & set(two), "the file of this vehicle"
    assert make_plan(arena).slices["link.uav1.json"]["params"] == one


def test_params_file_does_not_replace_a_failsafe_of_the_yaml(folder: Path) -> None:
    (folder / "tuned.params").write_text(
        "COM_LOW_BAT_ACT 0\nBAT_CRIT_THR 0.07\nCOM_FAIL_ACT_T 5\nCOM_OBL_RC_ACT 0\nMPC_XY_P 0.9\n"
    )
    text = f"{NATNET}failsafe: {{low_battery: {{warn: 0.3, land: 0.2}}}}\nvehicles:\n  uav1: {HARDWARE}, params_file: tuned.params}}\n"
    made = firmware(load(text), load(text).vehicle("uav1"))
    assert (made.values["COM_LOW_BAT_ACT"], made.values["BAT_CRIT_THR"], made.values["COM_FAIL_ACT_T"]) == (
        2,
        0.2,
        0,
    )
    assert (made.values["COM_OBL_RC_ACT"], made.values["MPC_XY_P"]) == (0, 0.9), (
        "defaults that nobody has written yield"
    )
    assert made.replaced == ("BAT_CRIT_THR", "COM_FAIL_ACT_T", "COM_LOW_BAT_ACT") and not made.not_possible


def test_params_file_of_a_day_of_hitl_does_not_switch_the_battery_failsafe_off(folder: Path) -> None:
    (folder / "tuned.params").write_text("CBRK_SUPPLY_CHK 894281\nRTL_RETURN_ALT 60\n")
    text = f"{NATNET}world: {{size: [8, 6, 4]}}\nvehicles:\n  uav1: {HARDWARE}, params_file: tuned.params}}\n"
    made = firmware(load(text), load(text).vehicle("uav1"))
    assert made.values["CBRK_SUPPLY_CHK"] == 0 and made.values["RTL_RETURN_ALT"] < 4.0
    assert made.replaced == ("CBRK_SUPPLY_CHK", "RTL_RETURN_ALT")


def test_params_file_of_a_range_of_vehicles_is_shared(folder: Path) -> None:
    (folder / "tuned.params").write_text(OF_ONE_VEHICLE)
    arena = load(
        "vehicles:\n  uav1..uav2: {autopilot: builtin, params_file: tuned.params, start: {grid: {columns: 2, spacing_m: 1}}}\n"
    )
    assert len(left_out_names(arena, arena.vehicle("uav2"))) == 4


SIMULATOR_VALUES = ("MPC_THR_HOVER", "EKF2_EV_DELAY", "EKF2_EVP_NOISE", "MC_ROLLRATE_P", "MPC_TKO_RAMP_T")
MEASURED = "measured: {MPC_THR_HOVER: {value: 0.42, date: 2026-11-20, how: 30 s of hover}}"


def test_fault_12_hardware_keeps_its_own_values_instead_of_the_simulators() -> None:
    arena = load(f"{NATNET}vehicles:\n  uav1: {HARDWARE}}}\n  uav2: {{autopilot: builtin}}\n")
    assert not set(SIMULATOR_VALUES) & set(values(arena))
    assert set(SIMULATOR_VALUES) <= set(values(arena, "uav2"))
    kept = unmeasured(arena, arena.vehicle("uav1"))
    assert set(SIMULATOR_VALUES) <= set(kept) and kept["MPC_THR_HOVER"] == pytest.approx(0.5652, abs=1e-4)
    assert not {name for name in kept if name.startswith(("CA_", "RC_"))}
    assert unmeasured(arena, arena.vehicle("uav2")) == {}


def test_fault_12_measured_values_are_demanded_with_date_and_method() -> None:
    arena = load(f"{NATNET}vehicles:\n  uav1: {HARDWARE}, {MEASURED}}}\n")
    assert values(arena)["MPC_THR_HOVER"] == 0.42
    assert "MPC_THR_HOVER" not in unmeasured(arena, arena.vehicles[0])
    source = origins(arena)["vehicles.uav1.params.MPC_THR_HOVER"].source
    assert source == "measured 2026-11-20, 30 s of hover (arena.yaml:3)"
    again = load(arena_yaml(arena))
    assert again.vehicles[0].measured == arena.vehicles[0].measured and values(again) == values(arena)


def test_measured_value_replaces_the_file_and_the_defaults(folder: Path) -> None:
    (folder / "old.params").write_text("MPC_THR_HOVER 0.3\n")
    text = f"{NATNET}defaults: {{params: {{MPC_THR_HOVER: 0.35}}}}\nvehicles:\n  uav1: {HARDWARE}, params_file: old.params, {MEASURED}}}\n"
    assert values(load(text))["MPC_THR_HOVER"] == 0.42


def test_misspelt_measured_parameter_is_refused() -> None:
    arena = load(f"{NATNET}vehicles:\n  uav1: {HARDWARE}, {MEASURED.replace('HOVER', 'HOVR')}}}\n")
    with pytest.raises(
        InputError, match=r"arena.yaml:3: vehicles.uav1.measured.MPC_THR_HOVR: .*MPC_THR_HOVER"
    ):
        check_arena(arena, [])


RADIO = "{autopilot: hardware, profile: iris, url: 'udpin:0.0.0.0:14580'"


@pytest.mark.parametrize(("version", "without"), [("1.9", 1.0), ("1.12", 1.0), ("1.16", 4.0), ("1.18", 4.0)])
def test_fault_1_hardware_has_a_pilot_unless_the_yaml_says_no(version: str, without: float) -> None:
    for key, expected in (("", 0.0), (", radio: required", 0.0), (", radio: none", without)):
        made = values(load(f"{NATNET}vehicles:\n  uav1: {RADIO}{key}}}\n"), version=version)
        assert made["COM_RC_IN_MODE"] == expected, key
        assert "RC_MAP_ROLL" not in made
    assert values(load(f"{NATNET}vehicles:\n  uav1: {RADIO}}}\n"))["NAV_RCL_ACT"] == 3.0


@pytest.mark.parametrize(
    ("version", "modes"), [("1.9", [0]), ("1.15", [0]), ("1.16", [0, 3]), ("1.17", [0, 3, 5, 7])]
)
def test_link_knows_the_modes_with_which_the_transmitter_works(version: str, modes: list[int]) -> None:
    arena = load(f"{NATNET}vehicles:\n  uav1: {RADIO}, px4_version: '{version}'}}\n")
    assert make_plan(arena).slices["link.uav1.json"]["preflight"]["radio"] == modes
    arena = load(f"{NATNET}vehicles:\n  uav1: {RADIO}, radio: none}}\n")
    assert make_plan(arena).slices["link.uav1.json"]["preflight"]["radio"] is None


@pytest.mark.parametrize("mode", [1, 2, 4])
def test_fault_1_a_parameter_that_ignores_the_transmitter_is_refused(mode: int) -> None:
    written = f"params: {{COM_RC_IN_MODE: {mode}}}"
    with pytest.raises(
        InputError, match="with which PX4 may ignore the pilot's RC transmitter; expected 0 or 3"
    ):
        make_plan(load(f"{NATNET}vehicles:\n  uav1: {RADIO}, {written}}}\n"))
    make_plan(load(f"{NATNET}vehicles:\n  uav1: {RADIO}, radio: none, {written}}}\n"))


@pytest.mark.parametrize(
    ("failsafe", "params", "found"),
    [
        ("offboard_loss: {action: land}", "COM_OBL_RC_ACT: 7", "got 7, but failsafe.offboard_loss"),
        ("offboard_loss: {after_s: 1.0}", "COM_OF_LOSS_T: 50", "got 50, but failsafe.offboard_loss"),
        ("geofence: {action: land}", "GF_ACTION: 0", "got 0, but failsafe.geofence"),
        ("offboard_loss: {action: land}", "COM_OBL_RC_ACT: 4", ""),
        ("offboard_loss: {action: land}", "GF_ACTION: 0", ""),
    ],
)
def test_parameter_that_contradicts_a_written_failsafe_is_refused(
    failsafe: str, params: str, found: str
) -> None:
    arena = load(f"{NATNET}failsafe: {{{failsafe}}}\nvehicles:\n  uav1: {HARDWARE}, params: {{{params}}}}}\n")
    if not found:
        make_plan(arena)
        return
    with pytest.raises(InputError, match=rf"{found} .*needs .*Remove one of them"):
        make_plan(arena)


def test_version_of_the_command_line_replaces_the_vehicles() -> None:
    v = load(VEHICLES).vehicles[0]
    assert (px4_version(v), px4_version(v, "1.13"), px4_version(None)) == ("1.16", "1.13", "1.16")


def test_written_parameters_are_checked_with_their_places(tmp_path: Path) -> None:
    (tmp_path / "tuned.params").write_text("EKF2_EV_CRTL 11\nMPC_XY_P 0.9\n")
    file = tmp_path / "arena.yaml"
    file.write_text(
        "vehicles:\n  uav1:\n    autopilot: builtin\n    params_file: tuned.params\n    params:\n      MPC_LAND_SPEED: 0.1\n"
    )
    found = written_param_findings(load_arena("arena.yaml"))
    assert [(each.vehicle, each.place, each.finding.name, each.finding.expected) for each in found] == [
        ("uav1", "tuned.params", "EKF2_EV_CRTL", "perhaps EKF2_EV_CTRL"),
        ("uav1", "arena.yaml:6", "MPC_LAND_SPEED", "0.6 m/s or more"),
    ]
