"""Tests of programs that raise, hang, freeze or are killed in flight: only their own vehicle lands early."""

from __future__ import annotations

import pytest

from .flight import Hangar

pytestmark = pytest.mark.flight
REPORT = True  # these tests read the summary

BAD = {"thrower": "throws", "spinner": "spins", "frozen": "freezes", "killed": "is_killed"}


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_failing_program_lands_only_its_own_vehicle(hangar: Hangar, backend: str) -> None:
    if backend == "mavsdk":
        pytest.importorskip("mavsdk.plugins.mavlink_direct", reason="mavsdk is not installed")
    flight = hangar.fly({**BAD, "good": "tours"}, "--until-done", "--set", f"defaults.backend={backend}")
    flight.until_up()
    flight.until_disarmed(BAD, 25)
    assert flight.fact("good.armed") is True and flight.fact("good.mode") == "OFFBOARD"
    flight.until_event("program.good", "EXITED", 30)
    assert flight.process.poll() is None  # two programs have not ended

    down = flight.cli("down", "--run", str(flight.folder))
    assert down.returncode == 1 and flight.wait() == 1

    failed = flight.summary["failed"]
    assert [f.partition(":")[0] for f in failed] == [f"program.{name}" for name in BAD]
    reasons = dict(f.removeprefix("program.").split(": ", 1) for f in failed)
    assert reasons["thrower"] == "exit 1" and reasons["killed"] == "killed by SIGKILL"
    for hung in ("spinner", "frozen"):
        assert reasons[hung].startswith("had not ended by itself")
    assert all(f in (flight.folder / "summary.txt").read_text() for f in failed)
    assert "thrower: last line of its log: ValueError: no such place" in flight.said()

    for name in BAD:
        verdict = flight.verdict(name)
        assert verdict["crashed"] == "" and verdict["landings"] == 1 and verdict["touchdown_m_s"] < 1.5
        assert flight.summary["vehicles"][name]["landing"]["landed"]
        offboard, land, off = [m for m in flight.summary["vehicles"][name]["modes"] if m["armed"]] + [
            {"mode": "", "t_s": 0}
        ]
        assert (offboard["mode"], land["mode"], off["mode"]) == ("OFFBOARD", "AUTO.LAND", "")
        assert (
            6.5 < land["t_s"] - offboard["t_s"] < 20.0
        )  # 6 s of setpoints, 1 s of none, told by heartbeats a second apart; longer on a starved machine
    good = flight.summary["vehicles"]["good"]
    assert (
        good["setpoints"]["worst_m"] <= 0.10
        and good["setpoints"]["count"] == 4
        and good["landing"]["error_m"] <= 0.3
    )
    assert flight.outcome["processes"]["program.good"]["exit_code"] == 0

    to = {name: [e["to"] for e in flight.events(f"program.{name}") if "to" in e] for name in (*BAD, "good")}
    assert to["thrower"] == to["killed"] == to["good"] == ["STARTING", "READY", "EXITED"]
    assert to["spinner"] == to["frozen"] == ["STARTING", "READY", "STOPPING", "EXITED"]
    flight.assert_nothing_left()
