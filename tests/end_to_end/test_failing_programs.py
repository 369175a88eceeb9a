"""Tests of programs that raise, hang, freeze or are killed in flight, on both backends: only their own vehicle lands early."""

from __future__ import annotations

import pytest

from .flight import Hangar
from .test_failing_backends import both, fly, names

pytestmark = pytest.mark.flight

BAD = {"thrower": "throws", "spinner": "spins, '4'", "frozen": "freezes", "killed": "is_killed"}
GOOD = {"good": "tours"}


def test_failing_program_lands_only_its_own_vehicle(hangar: Hangar) -> None:
    flight = fly(hangar, {**BAD, **GOOD})
    flight.until_up()
    for name in both(GOOD):
        flight.until_event(f"program.{name}", "EXITED", 90)
    flight.until_disarmed(both(BAD), 25)
    assert flight.process.poll() is None  # the programs that hang have not ended

    down = flight.cli("down", "--run", str(flight.folder))
    assert down.returncode == 1 and flight.wait() == 1

    failed = flight.summary["failed"]
    assert [f.partition(":")[0] for f in failed] == [f"program.{name}" for name in both(BAD)]
    reasons = dict(f.removeprefix("program.").split(": ", 1) for f in failed)
    for name in names(("thrower",)):
        assert reasons[name] == "exit 1"
        assert f"{name}: last line of its log: ValueError: no such place" in flight.said()
    assert all(reasons[name] == "killed by SIGKILL" for name in names(("killed",)))
    for hung in names(("spinner", "frozen")):
        assert reasons[hung].startswith("had not ended by itself")
    assert all(f in (flight.folder / "summary.txt").read_text() for f in failed)

    vehicles, disarmed_s = flight.summary["vehicles"], {}
    for name in both(BAD):
        verdict = flight.verdict(name)
        assert verdict["crashed"] == "" and verdict["landings"] == 1 and verdict["touchdown_m_s"] < 1.5
        assert vehicles[name]["landing"]["landed"]
        offboard, land = [m for m in vehicles[name]["modes"] if m["armed"]]
        assert (offboard["mode"], land["mode"]) == ("OFFBOARD", "AUTO.LAND")
        # 6 s of setpoints and 1 s of none, both known from heartbeats a second apart
        assert 6.0 < land["t_s"] - offboard["t_s"] < 9.5, name
        disarmed_s[name] = vehicles[name]["modes"][-1]["t_s"]
        assert not vehicles[name]["modes"][-1]["armed"]
    for name in both(GOOD):
        good = vehicles[name]
        assert good["setpoints"]["worst_m"] <= 0.10 and good["setpoints"]["count"] == 4
        assert good["landing"]["error_m"] <= 0.3
        assert flight.outcome["processes"][f"program.{name}"]["exit_code"] == 0
        (land,) = [m for m in good["modes"] if m["mode"] == "AUTO.LAND" and m["armed"]]
        assert land["t_s"] > max(disarmed_s.values()), "it landed before the others were disarmed"

    to = {
        name: [e["to"] for e in flight.events(f"program.{name}") if "to" in e]
        for name in both({**BAD, **GOOD})
    }
    for name in names(("thrower", "killed", "good")):
        assert to[name] == ["STARTING", "READY", "EXITED"]
    for name in names(("spinner", "frozen")):
        assert to[name] == ["STARTING", "READY", "STOPPING", "EXITED"]
    flight.assert_nothing_left()
