"""Tests of parameters read and written through the router: built-in autopilot, stand-in and real PX4."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from arena.emergency.targets import from_plan
from arena.params.transfer.session import pull, push
from arena.params.transfer.transports import ParamTarget
from arena.schema.px4 import find_px4
from arena.wire.mavlink_params import Value

from .flight import Flight, Hangar

pytestmark = pytest.mark.flight

NUMBER = 200 + os.getpid() % 40
"""PX4 binds its ports on every address, so this id is used by no other test."""
INT32 = 6
A_SIGNALLING_NAN = -5_000_001
"""Return the float with the same bytes."""


def targets_of(flight: Flight) -> dict[str, ParamTarget]:
    flight.until_event("router", "READY", 60)
    return {
        t.name: ParamTarget(system=t.id, remote=t.tools)
        for t in from_plan((flight.folder / "plan.json").read_text())
    }


def another(value: Value) -> float:
    """Return a new value that PX4 accepts."""
    return (
        (1 - value.value if value.value in (0, 1) else value.value + 1)
        if value.kind == INT32
        else value.value * 0.9 + 0.01
    )


def sixty(values: Mapping[str, Value]) -> dict[str, float]:
    """Return new values for 30 integers and 30 floats; ids and link settings are not changed."""
    calm_names = ("MPC_", "MC_", "MIS_", "RTL_", "NAV_", "GF_", "LNDMC_", "EKF2_", "COM_")
    calm = [v for n, v in values.items() if n.startswith(calm_names)]
    chosen = [v for v in calm if v.kind == INT32][:30] + [v for v in calm if v.kind != INT32][:30]
    return {v.name: another(v) for v in chosen}


def yaml(folder: Path, autopilot: str) -> Path:
    file = folder / "arena.yaml"
    file.write_text(
        f"world: {{size: [10, 10, 5]}}\nvehicles:\n  uav1: {{autopilot: {autopilot}, id: {NUMBER}}}\n"
    )
    return file


@pytest.mark.parametrize("autopilot", ["builtin", "stand-in", pytest.param("real", marks=pytest.mark.px4)])
def test_parameters_are_listed_written_and_unknown_names_reported(hangar: Hangar, autopilot: str) -> None:
    options = ["--set", "px4.home=stand-in"] if autopilot == "stand-in" else []
    if autopilot == "real" and ((found := find_px4()) is None or found.stand_in):
        pytest.skip("no PX4 is found: set PX4_HOME")
    flight = hangar.up(yaml(hangar.folder, "builtin" if autopilot == "builtin" else "px4"), *options)
    targets = targets_of(flight)
    before = pull(targets)["uav1"]
    assert before.complete and len(before.values) == {v.total for v in before.values.values()}.pop(), (
        before.ending,
        before.missing,
    )
    wanted = sixty(before.values)
    assert len(wanted) == (60 if autopilot == "real" else len(wanted)) and len(wanted) > 40
    if autopilot == "real":
        wanted["COM_FLIGHT_UUID"] = A_SIGNALLING_NAN
    report = push(targets, {"uav1": {**wanted, "NO_SUCH_NAME": 1.0}})["uav1"]
    assert report.ending == "done" and report.with_outcome("unknown") == ["NO_SUCH_NAME"], report
    refused = report.with_outcome("refused")
    assert set(report.with_outcome("written")) == set(wanted) - set(refused) and (
        autopilot != "real" or not refused
    ), report
    after = pull(targets, names=list(wanted))["uav1"]
    assert after.complete and all(
        after.values[n].value == pytest.approx(wanted[n]) for n in wanted if n not in refused
    )
    again = push(targets, {"uav1": {n: v for n, v in wanted.items() if n not in refused}})["uav1"]
    assert set(r.outcome for r in again.results.values()) == {"same"}
    told = {"list": before.traffic, "push": report.traffic, "names": len(before.values)}
    print(autopilot, json.dumps(told, default=str), file=sys.stderr)


@pytest.mark.parametrize("autopilot", ["builtin", pytest.param("real", marks=pytest.mark.px4)])
def test_params_push_writes_what_the_yaml_asks_for(hangar: Hangar, autopilot: str) -> None:
    if autopilot == "real" and ((found := find_px4()) is None or found.stand_in):
        pytest.skip("no PX4 is found: set PX4_HOME")
    file = yaml(hangar.folder, "builtin" if autopilot == "builtin" else "px4")
    flight = hangar.up(file)
    targets_of(flight)
    pull(targets_of(flight))  # it is heard, and has booted
    loss = "offboard_loss: {action: hold, after_s: 0.6}, low_battery: {land: null}"
    file.write_text(f"{file.read_text()}landing_speed_m_s: 0.9\nfailsafe: {{{loss}}}\n")
    where = ("--arena", str(file), "--set", f"address={hangar.address}")
    differ = flight.cli("params", "diff", "uav1", "yaml:uav1", *where)
    assert differ.returncode == 1, differ.stderr
    assert {line.split()[0] for line in differ.stdout.splitlines()[1:] if line.strip()} == {
        "COM_LOW_BAT_ACT",
        "COM_OBL_RC_ACT",
        "COM_OF_LOSS_T",
        "MPC_LAND_SPEED",
    }, differ.stdout
    tried = flight.cli("params", "push", "--dry-run", *where)
    assert tried.returncode == 0 and "4 differs" in tried.stdout, tried.stdout
    pushed = flight.cli("params", "push", *where)
    assert pushed.returncode == 0 and "4 written" in pushed.stdout, pushed.stdout + pushed.stderr
    same = flight.cli("params", "diff", "uav1", "yaml:uav1", *where)
    assert (same.returncode, same.stdout) == (0, "uav1 and yaml:uav1: no difference\n"), (
        same.stdout + same.stderr
    )
