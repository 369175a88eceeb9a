"""Which process may be restarted, and when."""

import pytest

from arena.supervisor.restart_rules import restart_refusal

from .conftest import spec


@pytest.mark.parametrize("kind", ["world", "replay"])
def test_process_that_keeps_the_clock_is_never_restarted(kind):
    with pytest.raises(ValueError, match=f"{kind} is not restarted.*arena down"):
        restart_refusal(spec(kind, kind, kind=kind), [], runs=True, flies_real=False)


@pytest.mark.parametrize("kind", ["px4", "link", "mocap", "forward", "router", "copilot"])
def test_restart_of_what_a_flying_vehicle_needs_is_refused(kind):
    process = spec("x", "x", kind=kind)
    assert "uav1, uav2 may be flying" in restart_refusal(
        process, ["uav1", "uav2"], runs=True, flies_real=False
    )
    assert restart_refusal(process, [], runs=True, flies_real=False) == ""


def test_restart_of_one_vehicles_process_looks_at_that_vehicle_only():
    forwarder = spec("forward.uav1", "x", kind="forward", vehicle="uav1")
    assert restart_refusal(forwarder, ["uav2"], runs=True, flies_real=False) == ""
    assert "uav1 may be flying" in restart_refusal(forwarder, ["uav1", "uav2"], runs=True, flies_real=False)


@pytest.mark.parametrize("kind", ["program", "group", "recorder", "tool"])
def test_restart_of_other_processes_is_allowed_in_flight(kind):
    assert restart_refusal(spec("x", "x", kind=kind), ["uav1"], runs=True, flies_real=False) == ""


def test_running_program_of_a_flying_real_vehicle_needs_yes():
    process = spec("program.uav1", "x", kind="program", vehicle="uav1")
    refusal = restart_refusal(process, ["uav1", "uav2"], runs=True, flies_real=True)
    assert refusal.startswith(
        "program.uav1 is not restarted: uav1 may be flying. During a restart the setpoints stop"
    )
    assert restart_refusal(process, ["uav2"], runs=True, flies_real=True) == ""


@pytest.mark.parametrize("kind", ["program", "copilot", "forward"])
def test_restart_of_a_process_that_has_ended_is_allowed_in_flight(kind):
    process = spec("x", "x", kind=kind, vehicle="uav1")
    assert restart_refusal(process, ["uav1"], runs=False, flies_real=kind == "program") == ""
