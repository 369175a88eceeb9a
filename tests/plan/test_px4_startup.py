"""Startup of PX4: what waits for it, and parameters that it resets."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from arena.plan import make_plan
from arena.plan.px4_startup import hitl_params, px4_params, reset_by_startup
from arena.schema import load_arena

EXAMPLE = Path(__file__).parents[2] / "examples" / "01_two_quads" / "arena.yaml"


def test_missing_px4_stops_its_own_forwarder_and_program_only(
    tmp_path: Path,
) -> None:
    file = tmp_path / "arena.yaml"
    (tmp_path / "fly.py").touch()
    file.write_text(
        "px4: {home: stand-in}\ndefaults: {program: fly.py}\nvehicles: {uav1: {autopilot: px4},"
        " uav2: {autopilot: px4, start: {position: [1, 0, 0]}}, uav3: {autopilot: builtin, start: {position: [2, 0, 0]}}}\n"
    )
    needs = {spec.name: set(spec.needs) for spec in make_plan(load_arena(file)).processes}

    def lost_with(dead: str) -> set[str]:
        """All that would never start."""
        gone = {dead}
        while more := {name for name, wanted in needs.items() if wanted & gone} - gone:
            gone |= more
        return gone

    assert lost_with("px4.uav1") == {"px4.uav1", "forward.uav1", "program.uav1"}


def test_firmware_default_is_set_again_after_px4s_startup() -> None:
    asked = {"COM_LOW_BAT_ACT": 0, "MPC_XY_P": 0.95, "MPC_Z_P": 1.5, "NOT_PX4S": 0}
    assert reset_by_startup(asked, "1.16.0") == {"COM_LOW_BAT_ACT": 0, "MPC_XY_P": 0.95}
    assert reset_by_startup(asked, "") == reset_by_startup(asked, "1.18"), (
        "one that does not say is taken for the newest"
    )


@pytest.mark.parametrize(("rotors", "mav_type"), [(4, 2), (6, 13), (8, 14)])
def test_px4_gets_an_output_for_each_motor_and_the_type_of_the_vehicle(rotors: int, mav_type: int) -> None:
    vehicle = load_arena(EXAMPLE).vehicles[0]
    ring = tuple(vehicle.profile.rotors[k % 4] for k in range(rotors))
    profile = vehicle.profile.model_copy(update={"rotors": ring, "num_rotors": rotors})
    found = px4_params(dataclasses.replace(vehicle, profile=profile), {})
    functions = {name: value for name, value in found.items() if name.startswith("PWM_MAIN_FUNC")}
    assert functions == {f"PWM_MAIN_FUNC{k + 1}": 101 + k for k in range(rotors)}
    assert found["MAV_TYPE"] == mav_type


def test_flight_controller_in_the_loop_keeps_its_pwm_outputs() -> None:
    found = hitl_params(load_arena(EXAMPLE).vehicles[0], {})
    assert not any(name.startswith("PWM_MAIN") for name in found)
    assert found["HIL_ACT_FUNC4"] == 104
