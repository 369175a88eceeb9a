"""Flights of four vehicles whose programs run in one process."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from .flight import PROGRAMS, Flight, Hangar

pytestmark = pytest.mark.flight

NAMES = ("uav1", "uav2", "uav3", "uav4")


def fly(hangar: Hangar, program: str, *, args: str = "", once: bool = False) -> Flight:
    file = hangar.folder / "arena.yaml"
    run = ", run: once" if once else ""
    file.write_text(
        "world: {size: [10, 10, 4]}\n"
        f"defaults: {{autopilot: builtin, program: {{path: '{PROGRAMS / program}', args: [{args}], group: show{run}}}}}\n"
        "vehicles:\n  uav1..uav4: {start: {position: [1, -1, 0], grid: {columns: 2, spacing_m: 2}}}\n"
    )
    flight = hangar.up(file, "--speed", "max", "--seed", "5", "--until-done", "--time-limit", "300")
    flight.wait(300)
    return flight


def csv_hashes(flight: Flight) -> dict[str, str]:
    folder: Path = flight.folder / "csv"
    return {name: hashlib.sha256((folder / f"{name}.csv").read_bytes()).hexdigest() for name in NAMES}


def test_failing_program_of_a_group_ends_alone_and_flights_are_repeatable(hangar: Hangar) -> None:
    one, two = (fly(hangar, "in_group.py", args="throws") for _ in range(2))
    assert one.outcome["exit_code"] == 1
    rows = one.outcome["processes"]
    assert [rows[f"program.{name}"]["exit_code"] for name in NAMES] == [0, 0, 1, 0]
    assert rows["program.uav3"]["reason"] == "exit 1 (ValueError: no such place)"
    assert rows["program.uav1"]["member_of"] == "group.show" and rows["group.show"]["exit_code"] == 1
    for name in NAMES:
        verdict, summary = one.verdict(name), one.summary["vehicles"][name]
        assert verdict["crashed"] == "" and verdict["landings"] == 1 and summary["landing"]["landed"]
    assert one.verdict("uav3")["airborne_s"] < one.verdict("uav1")["airborne_s"]
    assert csv_hashes(one) == csv_hashes(two)
    one.assert_nothing_left()


def test_all_vehicles_of_a_killed_choreographer_land_by_their_failsafe(hangar: Hangar) -> None:
    flight = fly(hangar, "choreographer.py", args="killed", once=True)
    assert flight.outcome["exit_code"] == 1
    assert flight.outcome["processes"]["group.show"]["exit"] == "killed by SIGKILL"
    for name in NAMES:
        verdict, summary = flight.verdict(name), flight.summary["vehicles"][name]
        assert verdict["crashed"] == "" and verdict["landings"] == 1 and summary["landing"]["landed"]
        assert [m["mode"] for m in summary["modes"] if m["armed"]] == ["OFFBOARD", "AUTO.LAND"]
    flight.assert_nothing_left()
