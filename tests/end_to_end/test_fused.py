"""Flights of an arena whose parts share one process: repeatable, and the same as with many processes."""

from __future__ import annotations

import csv
import platform
from pathlib import Path

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from .flight import PROGRAMS, ROOT, Flight, Hangar

pytestmark = pytest.mark.flight
YAML = ROOT / "examples" / "01_two_quads" / "arena.yaml"
VEHICLES = ("uav1", "uav2")
ANOTHER_CPU = """
world:
  size: [8, 8, 5]
  wind_m_s: [1, 0.5, 0]
  gusts_m_s: 4
  obstacles: {{crate: {{position: [3, 3, 0], size: [0.5, 0.5, 1], rpy_deg: [0, 0, 30]}}}}
defaults: {{program: {{path: '{program}', args: [lands]}}}}
vehicles:
  uav1: {{start: {{position: [0, 0, 0], rpy_deg: [0, 0, 40]}}}}
  uav2: {{start: {{position: [0.9, 0, 0]}}, sensors: {{imu: {{accel_vibration_m_s2: 1.0, vibration_hz: 80}}}}}}
"""
OLDER_CPU = {
    "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name)),
    "OPENBLAS_CORETYPE": {"x86_64": "Prescott"}.get(platform.machine(), "ARMV8"),
}
"""Environment in which numpy uses only the instructions that every CPU of this architecture has."""


def fly(hangar: Hangar, *options: str) -> Flight:
    """Fly the first example as fast as possible, to its end."""
    flight = hangar.up(YAML, "--speed", "max", "--until-done", "--no-report", "--time-limit", "300", *options)
    code = flight.wait(360)
    assert code == 0, flight.said()
    assert flight.folder.exists()  # found now: later the folder of the next flight would be new, too
    return flight


def logs(flight: Flight) -> dict[str, bytes]:
    return {v: (flight.folder / "csv" / f"{v}.csv").read_bytes() for v in VEHICLES}


def truth(flight: Flight, vehicle: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the time after the vehicle entered OFFBOARD [s] (n,) and the true position [m] [NED] (n, 3)."""
    rows = list(csv.DictReader((flight.folder / "csv" / f"{vehicle}.csv").open()))
    columns = ("truth.pos.north", "truth.pos.east", "truth.pos.down")
    times = np.array([float(r["time.seconds"]) for r in rows])
    first = next(t for t, r in zip(times, rows, strict=True) if r["info.flight_mode"] == "OFFBOARD")
    return times - first, np.array([[float(r[c]) for c in columns] for r in rows])


@pytest.fixture(scope="module")
def first(shared_hangar: Hangar) -> Flight:
    return fly(shared_hangar, "--seed", "7")


def test_same_seed_gives_the_same_logs_byte_for_byte(first: Flight, shared_hangar: Hangar) -> None:
    again = fly(shared_hangar, "--seed", "7")
    assert logs(again) == logs(first)
    for v in VEHICLES:
        one, other = ((flight.folder / "ulog" / f"{v}.ulg").read_bytes() for flight in (first, again))
        assert one == other and len(one) > 500_000


def test_another_cpu_flies_the_same_flight(
    hangar: Hangar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A CPU without the newest instructions: numpy and its matrix products then use others, which round differently."""
    (tmp_path / "arena.yaml").write_text(ANOTHER_CPU.format(program=PROGRAMS / "fly.py"))
    found = []
    for older in (False, True):
        if older:
            for name, value in OLDER_CPU.items():
                monkeypatch.setenv(name, value)
        options = ("--speed", "max", "--until-done", "--no-report", "--time-limit", "300")
        flight = hangar.up(tmp_path / "arena.yaml", *options, "--seed", "7")
        assert flight.wait(360) == 0, flight.said()
        found.append([(flight.folder / "csv" / f"{v}.csv").read_bytes() for v in VEHICLES])
    assert found[0] == found[1]


def test_mavsdk_flies_within_1_mm_of_pymavlink(first: Flight, shared_hangar: Hangar) -> None:
    """The setpoints arrive in the same steps. MAVSDK's degrees round the yaw differently, by one bit of a 32-bit float."""
    pytest.importorskip("mavsdk.plugins.mavlink_direct", reason="mavsdk is not installed")
    other = fly(shared_hangar, "--seed", "7", "--set", "defaults.backend=mavsdk")
    for v in VEHICLES:
        (t, p), (t_first, p_first) = truth(other, v), truth(first, v)
        assert np.array_equal(t, t_first) and np.abs(p - p_first).max() < 0.001


def test_another_seed_gives_another_flight(first: Flight, shared_hangar: Hangar) -> None:
    other = logs(fly(shared_hangar, "--seed", "8"))
    assert all(other[v] != logs(first)[v] for v in VEHICLES)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_truth_is_within_2_cm_of_a_flight_with_many_processes(
    first: Flight, many: Flight, vehicle: str
) -> None:
    """Every place of the fused flight is within 2 cm of the other flight's path. At the same time, the median distance is below 2 cm.

    At the same time, single distances may be larger: the zero of time, the entry into OFFBOARD, is exact to one row of the log
    (1/30 s).
    """
    (t_one, p_one), (t_many, p_many) = truth(first, vehicle), truth(many, vehicle)
    path = places_at(np.arange(0.0, t_many[-1], 0.01), t_many, p_many)
    times = np.arange(0.0, min(t_one[-1], t_many[-1]), 0.1)
    one = places_at(times, t_one, p_one)
    apart = np.linalg.norm(one - places_at(times, t_many, p_many), axis=1)
    from_path = np.linalg.norm(one[:, None] - path, axis=2).min(axis=1)
    print(f"{vehicle}: median {np.median(apart):.4f} m, from the path at most {from_path.max():.4f} m")
    assert len(times) > 200 and np.median(apart) < 0.02 and from_path.max() < 0.02


def places_at(times: np.ndarray, t: np.ndarray, p_n: np.ndarray) -> np.ndarray:
    """Return the places of a flight at these times [m] [NED] (k, 3). t (n,), p_n (n, 3): the flight."""
    return np.column_stack([np.interp(times, t, p_n[:, k]) for k in range(3)])


def test_a_program_that_crashes_at_once_does_not_delay_the_flight(
    shared_hangar: Hangar, tmp_path: Path
) -> None:
    (tmp_path / "crash.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "arena.yaml").write_text("vehicles:\n  uav1: {program: crash.py}\n")
    flight = shared_hangar.up(tmp_path / "arena.yaml", "--speed", "max", "--until-done", "--no-report")
    assert flight.wait(120) == 1
    assert flight.outcome["processes"]["program.uav1"]["exit_code"] == 3
    world = flight.outcome["processes"]["world"]
    assert world["stats"]["sim_time_s"] > 1.0, "simulation time has not begun"
    assert "has not slept" not in (flight.folder / "events.jsonl").read_text()


@pytest.mark.crowd
def test_five_vehicles_fly_in_one_process_in_real_time(hangar: Hangar) -> None:
    vehicles = {f"uav{k}": "lands" for k in range(1, 6)}
    flight = hangar.fly(vehicles, "--until-done", "--no-report", "--time-limit", "300")
    assert flight.wait(360) == 0, flight.said()
    assert flight.outcome["processes"]["router"]["member_of"] == "world"
    for name in vehicles:
        told = flight.verdict(name)
        assert told["crashed"] == "" and told["max_height_m"] > 0.9, name
    flight.assert_nothing_left()


@pytest.fixture(scope="module")
def many(shared_hangar: Hangar) -> Flight:
    return fly(shared_hangar, "--seed", "7", "--processes")


def test_summary_and_tables_are_those_of_many_processes(first: Flight, many: Flight) -> None:
    one, other = first.outcome["processes"], many.outcome["processes"]
    assert one.keys() == other.keys()
    assert one["router"]["member_of"] == "world" and one["router"]["pid"] is None
    assert one["router"]["stats"].keys() >= {"frames_from_vehicles", "telemetry"}
    assert one["forward.uav1"]["stats"]["poses"] > 100
