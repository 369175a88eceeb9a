"""Tests that every example passes `arena check` and flies. `tests/end_to_end/test_two_quads.py` has more on the first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from end_to_end.flight import ROOT, Flight, Hangar
from pyulog import ULog

from arena.cli import main

EXAMPLES = sorted((ROOT / "examples").glob("*/arena.yaml"))
FLOWN_ELSEWHERE = {"01_two_quads", "14_two_backends"}
REPORT = True
CROWDED = {"10_ten_quads"}
SWARM = {"11_swarm"}
SHORT = [e for e in EXAMPLES if e.parent.name not in FLOWN_ELSEWHERE | CROWDED | SWARM]


def name_of(yaml: Path) -> str:
    return yaml.parent.name


@pytest.mark.parametrize("yaml", EXAMPLES, ids=name_of)
def test_example_passes_check(yaml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["check", str(yaml), "--no-machine"])  # whose ports somebody else may be flying on
    said = capsys.readouterr()
    assert code == 0 and said.out.startswith(f"ok: {name_of(yaml)}"), said.err


def fly(hangar: Hangar, yaml: Path) -> None:
    """Fly an example in lockstep at full speed, so that the result does not depend on the machine."""
    flight = hangar.up(
        yaml, "--until-done", "--time-limit", "300", "--speed", "max", "--set", "defaults.autopilot=builtin"
    )
    assert flight.wait(180) == 0, flight.said()
    print((flight.folder / "summary.txt").read_text())
    summary = flight.summary
    assert summary["cause"] == "done" and summary["failed"] == [] and summary["missing"] == []
    for name, told in summary["vehicles"].items():
        log = ULog(str(flight.folder / "ulog" / f"{name}.ulg"))
        assert log.get_dataset("vehicle_status").data["arming_state"][-1] == 1 and not log.dropouts
        assert told["landing"]["landed"] and told["landing"]["error_m"] <= 0.3
        assert told["crashed"] == "" and told["verdict"]["airborne_s"] > 15
        assert told["setpoints"]["count"] >= 2 and told["setpoints"]["worst_m"] <= 0.10, told["setpoints"]
    flight.assert_nothing_left()


@pytest.mark.flight
@pytest.mark.parametrize("yaml", SHORT, ids=name_of)
def test_example_flies_lands_and_exits_with_0(hangar: Hangar, yaml: Path) -> None:
    fly(hangar, yaml)


@pytest.mark.crowd
@pytest.mark.parametrize("yaml", [e for e in EXAMPLES if name_of(e) in CROWDED], ids=name_of)
def test_large_example_flies_lands_and_exits_with_0(hangar: Hangar, yaml: Path) -> None:
    fly(hangar, yaml)


@pytest.mark.crowd
@pytest.mark.nightly
def test_swarm_writes_its_word_and_every_vehicle_lands(hangar: Hangar) -> None:
    yaml = ROOT / "examples" / "11_swarm" / "arena.yaml"
    flight = hangar.up(
        yaml, "--until-done", "--time-limit", "1500", "--speed", "max", "--set", "defaults.autopilot=builtin"
    )
    assert flight.wait(600) == 0, flight.said()
    vehicles = flight.summary["vehicles"]
    assert len(vehicles) == 48 and flight.summary["failed"] == []
    assert all(told["landing"]["landed"] and told["crashed"] == "" for told in vehicles.values())
    assert nearest_m(flight) > 0.5
    words = flight.log("group.show")
    assert all(f"{letter} is written" in words for letter in "FLY")
    assert float(words.partition("worst_place_error_m: ")[2].split()[0]) < 0.1, words
    flight.assert_nothing_left()


def nearest_m(flight: Flight) -> float:
    """Return the smallest true distance of two airborne vehicles in the flight's logs [m]."""
    tracks = {}
    for name in flight.summary["vehicles"]:
        rows = [r for r in flight.rows(name) if r["truth.pos.north"]]
        times = [float(r["time.seconds"]) for r in rows]
        axes = ("north", "east", "down")
        tracks[name] = np.array([[float(r[f"truth.pos.{a}"]) for a in axes] for r in rows]), np.array(times)
    times = np.arange(0.0, min(t[-1] for _, t in tracks.values()), 0.1)
    at = np.array([[np.interp(times, t, p[:, k]) for k in range(3)] for p, t in tracks.values()])
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    return float(apart[np.triu_indices(len(at), 1)].min())
