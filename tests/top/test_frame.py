"""Tables of `arena top` from a synthetic snapshot."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from arena.constants import MAX_ROTORS
from arena.live_view import Event, FleetSnapshot, ProcessRow, Settings, Snapshot, VehicleSettings
from arena.top.frame import frame, row_numbers, waiting_frame
from arena.top.screen import is_complete


def snapshot(count: int = 2, **changes) -> Snapshot:
    """Return the state of an arena: vehicle k hovers at N k, E -k, 1.5 m high."""
    names = tuple(f"uav{k}" for k in range(1, count + 1))
    k = np.arange(1.0, count + 1)
    vectors, angles = np.full((count, 3), np.nan), np.full((count, 4), np.nan)
    fleet = FleetSnapshot(
        names=names,
        kinds=("simulated",) * count,
        modes=("OFFBOARD",) * count,
        armed=(True,) * count,
        landed=(False,) * count,
        connected=(True,) * count,
        controls=("program",) * count,
        texts=("",) * count,
        p_n=np.stack([k, -k, np.full(count, -1.5)], axis=1),
        v_n=np.tile([0.3, 0.4, 0.0], (count, 1)),
        q_nb=angles,
        omega_b=vectors,
        has_true=np.ones(count, bool),
        est_p_n=vectors,
        est_v_n=vectors,
        est_q_nb=angles,
        est_omega_b=vectors,
        set_p_n=vectors,
        set_v_n=vectors,
        set_yaw=np.full(count, np.nan),
        set_q_nb=angles,
        set_thrust=np.full(count, np.nan),
        motors=np.full((count, MAX_ROTORS), np.nan),
        battery=np.full(count, 87.0),
        pose_age_s=np.full(count, 0.008),
        silent_s=np.full(count, 0.05),
    )
    vehicle = VehicleSettings(
        name="uav1", id=1, kind="simulated", autopilot="builtin", index=0, body="uav1", tools=("127.0.0.1", 1),
        profile="iris", radius_m=0.3, height_m=0.1, rotors=(),
    )  # fmt: skip
    settings = Settings(
        size_m=(7.0, 4.0, 3.0), ceiling=True, fence=None, clock=None, truth=None, captures=(), vehicles=(vehicle,) * count
    )  # fmt: skip
    processes = (
        process("world", kind="world", cpu=0.314, memory_mb=108.4, rates={"step": 500.0}),
        process("forward.uav1", kind="forward", vehicle="uav1", member_of="world", rates={"pose": 59.9}),
        process("program.uav1", kind="program", state="BACKOFF", reason="exit 1", restarts=2),
    )
    given = Snapshot(
        run=Path("runs/x"),
        name="lab",
        phase="running",
        time_s=12.34,
        real_time_factor=0.999,
        answers=True,
        settings=settings,
        fleet=fleet,
        processes=processes,
        events=tuple(event(i) for i in range(20)),
    )
    return dataclasses.replace(given, **changes)


def process(name: str, **more) -> ProcessRow:
    given = {
        "kind": "x",
        "state": "READY",
        "reason": "",
        "cpu": 0.0,
        "memory_mb": 1.0,
        "restarts": 0,
        "member_of": "",
    }
    return ProcessRow(name=name, **{**given, **more})


def event(number: int, **more) -> Event:
    given = {"time_s": 1.0 * number, "source": "uav1", "text": f"event number {number}", "detail": False}
    return Event(number=number, **{**given, **more})


def text(shown: Snapshot, **more) -> str:
    console = Console(width=more.get("width", 140), record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(frame(shown, **more))
    return console.export_text()


def row(shown: Snapshot, name: str, **more) -> list[str]:
    return next(line.split() for line in text(shown, **more).splitlines() if line.split()[:1] == [name])


def with_fleet(shown: Snapshot, **changes) -> Snapshot:
    return dataclasses.replace(shown, fleet=dataclasses.replace(shown.fleet, **changes))


def test_vehicle_has_its_state_position_and_ages():
    words = " ".join(row(snapshot(), "uav2"))
    assert words == "uav2 OFFBOARD yes no program 87 % 2.00 m -2.00 m 1.50 m 0.5 m/s 8 ms - 50 ms"


def test_rate_of_the_poses_is_that_of_the_forwarder_of_the_vehicle():
    assert "60 Hz" in " ".join(row(snapshot(), "uav1")) and "Hz" not in " ".join(row(snapshot(), "uav2"))


def test_header_counts_vehicles_and_shows_the_real_time_factor():
    first = text(snapshot()).splitlines()[0]
    assert first == "lab: running   12.3 s   2 vehicles, 2 armed, 2 in the air   real-time factor 1.00"


def test_unknown_values_are_dashes():
    nothing = with_fleet(
        snapshot(1),
        modes=("",),
        armed=(None,),
        landed=(None,),
        controls=("",),
        p_n=np.full((1, 3), np.nan),
        v_n=np.full((1, 3), np.nan),
        battery=np.array([np.nan]),
        pose_age_s=np.array([np.nan]),
        silent_s=np.array([math.inf]),
    )
    assert row(dataclasses.replace(nothing, processes=()), "uav1") == ["uav1"] + ["-"] * 12


def test_vehicle_on_the_floor_has_no_negative_zero():
    assert "-0.00" not in text(with_fleet(snapshot(1), p_n=np.full((1, 3), 1e-3)))


@pytest.mark.parametrize("width", [60, 72, 80, 100, 110, 120, 140])
def test_values_that_do_not_fit_are_left_out_and_none_is_cut(width):
    shown = with_fleet(snapshot(2), modes=("AUTO.LOITER",) * 2, p_n=np.full((2, 3), -10.25))
    lines = text(shown, width=width, height=40).splitlines()
    line = next(line for line in lines if line.startswith("uav1"))
    assert "…" not in line and len(line) <= width
    for value in ("AUTO.LOITER", "87 %", "10.25 m", "8 ms"):
        assert value in line


def test_kinds_are_shown_if_a_vehicle_is_not_simulated():
    assert "kind" not in text(snapshot())
    mixed = text(with_fleet(snapshot(), kinds=("simulated", "real")))
    assert "kind" in mixed and "real " in mixed


def test_parts_of_a_process_are_left_out_and_failed_processes_come_first():
    lines = text(snapshot()).splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("process"))
    assert lines[start + 1].split() == ["program.uav1", "BACKOFF", "0", "1", "2", "exit", "1"]
    assert lines[start + 2].split() == ["world", "READY", "31", "108", "step", "500", "Hz"]
    assert not any("forward.uav1" in line for line in lines)


def test_newest_events_are_last_and_details_are_left_out():
    events = (*(event(k) for k in range(20)), event(20, text="ready", detail=True), event(21, time_s=None))
    lines = text(snapshot(events=events)).rstrip().splitlines()
    assert lines[-1].strip() == "uav1: event number 21" and lines[-2].split()[:2] == ["19.0", "s"]
    assert "ready" not in lines[-3]


def test_supervisor_that_does_not_reply_is_reported():
    assert "the supervisor does not reply" in text(snapshot(answers=False)).splitlines()[0]


@pytest.mark.parametrize("vehicles", [0, 1, 10, 48, 200])
@pytest.mark.parametrize("height", [12, 24, 50])
def test_frame_fits_the_terminal(vehicles, height):
    processes = tuple(process(f"program.uav{k}") for k in range(vehicles))
    shown = text(snapshot(vehicles, processes=processes), height=height)
    assert len(shown.rstrip("\n").splitlines()) <= height
    assert "q: quit" in shown


def test_hidden_vehicles_are_counted_and_can_be_scrolled_to():
    crowd = snapshot(48, processes=())
    assert "uav1 " in text(crowd, height=24) and "uav48" not in text(crowd, height=24)
    end = text(crowd, height=24, scrolled=47)
    assert "uav48" in end and "uav1 " not in end and " more" in end


def test_everything_is_printed_without_a_terminal():
    assert "uav48" in text(snapshot(48)) and "more" not in text(snapshot(48))


def test_all_rows_have_a_place_if_the_terminal_is_large():
    rows = row_numbers(10, 12, 20, 60, 0)
    assert (rows.vehicles, rows.processes, rows.events, rows.first) == (10, 12, 8, 0)


def test_waiting_frame_says_why():
    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(waiting_frame("no arena is running. Start one with `arena up`"))
    assert "no arena is running. Start one with `arena up`" in console.export_text()


def test_first_frame_is_complete_with_telemetry_of_all_vehicles():
    assert is_complete(snapshot())
    assert not is_complete(snapshot(processes=()))
    assert not is_complete(with_fleet(snapshot(), silent_s=np.array([0.1, math.inf])))
    assert not is_complete(with_fleet(snapshot(), battery=np.array([50.0, math.nan])))
