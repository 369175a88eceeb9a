"""`arena smoke` with real arenas: shipped scenarios pass, failures have their reason, and no process is left."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from end_to_end.flight import ROOT, eventually, started_by

from arena.schema.px4 import find_px4

SHIPPED, FAILSAFES = ROOT / "examples" / "05_smoke", ROOT / "examples" / "06_failsafes"
FOLDERS = sorted({path.parent for path in ROOT.glob("examples/*/*.smoke.yaml")})
# One or two scenarios of each folder, flown at every `make test`; `make nightly` flies all.
DAILY = [
    ROOT / "examples" / name
    for name in (
        "05_smoke/hover.smoke.yaml",
        "06_failsafes/low_battery.smoke.yaml",
        "06_failsafes/geofence.smoke.yaml",
        "07_faults/mocap_frozen.smoke.yaml",
        "07_faults/router_killed.smoke.yaml",
        "08_copilot/head_on.smoke.yaml",
    )
]
_LIMIT_S = 1800.0


class Smoke:
    """`arena smoke` in a process of its own, as a CI server starts it."""

    def __init__(self, folder: Path, temporary: Path, *arguments: str) -> None:
        self.results, self.out = folder / "results", folder / "out.txt"
        argv = [sys.executable, "-m", "arena.cli", "smoke", *arguments, "--results", str(self.results)]
        with self.out.open("wb") as out:
            self.process = subprocess.Popen(
                argv,
                stdout=out,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env={**os.environ, "TMPDIR": str(temporary)},
                start_new_session=True,
            )

    def wait(self) -> int:
        return self.process.wait(_LIMIT_S)

    @property
    def output(self) -> str:
        return self.out.read_text(errors="replace")

    @property
    def runs(self) -> list[Path]:
        """The run folders."""
        return sorted(path.parent for path in self.results.glob("*/*/plan.json"))


@pytest.fixture
def temporary() -> Iterator[Path]:
    """A short path in which arenas have their private folders: empty again when they have gone."""
    folder = Path(tempfile.mkdtemp(prefix="smoke-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def smoke(tmp_path: Path, temporary: Path) -> Iterator[Any]:
    begun: list[Smoke] = []

    def begin(*arguments: str) -> Smoke:
        begun.append(Smoke(tmp_path, temporary, *arguments))
        return begun[-1]

    yield begin
    for one in begun:
        if one.process.poll() is None:
            one.process.kill()
            one.process.wait()
        for run in one.runs:
            for pid in started_by(run):
                os.kill(pid, signal.SIGKILL)


def assert_nothing_left(smoke: Smoke, temporary: Path) -> None:
    assert [pid for run in smoke.runs for pid in started_by(run)] == []
    assert not [run for run in smoke.runs if (run / "state.json").exists()]
    # the lock of arenas with PX4 stays
    assert [left for left in temporary.glob("arena-smoke-*") if left.suffix != ".lock"] == []


@pytest.mark.crowd
@pytest.mark.parametrize(
    "scenarios",
    [
        pytest.param(DAILY, id="daily"),
        pytest.param(FOLDERS, id="all", marks=pytest.mark.nightly),
    ],
)
def test_shipped_scenarios_pass(smoke: Any, temporary: Path, tmp_path: Path, scenarios: list[Path]):
    flown = smoke(*map(str, scenarios), "-j", "2", "--seed", "3", "--junit", "junit.xml")
    assert flown.wait() == 0, flown.output
    print(flown.output)
    assert len(flown.runs) >= len(scenarios)
    assert f'tests="{len(flown.runs)}" failures="0"' in (tmp_path / "junit.xml").read_text()
    assert not [run for run in flown.runs if (run / "report.html").exists()]
    assert {json.loads((run / "slices" / "world.json").read_text())["seed"] for run in flown.runs} == {3}
    assert_nothing_left(flown, temporary)


@pytest.mark.crowd
@pytest.mark.px4
def test_every_failsafe_passes_on_a_real_px4(smoke: Any, temporary: Path):
    if find_px4() is None:
        pytest.skip("no PX4 is found: set PX4_HOME")
    flown = smoke(str(FAILSAFES), "--set", "defaults.autopilot=px4")
    assert flown.wait() == 0, flown.output
    print(flown.output)
    assert_nothing_left(flown, temporary)


FAILING = """
name: falls
arena: one.yaml
steps:
  - at: uav1.airborne + 3 s
    do: motor loss uav1 rotor 2
  - expect: uav1.mode == RTL within 2 s
"""


@pytest.mark.flight
def test_failed_scenario_has_its_reason_and_a_report(smoke: Any, temporary: Path, tmp_path: Path):
    for name in ("one.yaml", "square.py"):
        shutil.copy(SHIPPED / name, tmp_path)
    (tmp_path / "falls.smoke.yaml").write_text(FAILING)
    flown = smoke(str(tmp_path / "falls.smoke.yaml"))
    assert flown.wait() == 1, flown.output
    text = " ".join(flown.output.split())
    assert "falls.smoke.yaml:7: uav1.mode was" in text and "expected uav1.mode == RTL within 2 s" in text
    assert "uav1 crashed" in text
    page = (flown.runs[0] / "report.html").read_text()
    assert "FAILED: uav1 " in page and "expected uav1.mode == RTL within 2 s" in page
    assert_nothing_left(flown, temporary)


@pytest.mark.flight
@pytest.mark.parametrize("times", [1, 2])
def test_interruption_leaves_no_process(smoke: Any, temporary: Path, times: int):
    """A second interruption does not wait for the landing."""
    flown = smoke(str(SHIPPED / "hover.smoke.yaml"), "-j", "2")

    def airborne() -> bool:
        return any(
            "airborne" in (run / "events.jsonl").read_text()
            for run in flown.runs
            if (run / "events.jsonl").exists()
        )

    eventually(
        lambda: airborne() or flown.process.poll() is not None, 120, "one in the air", lambda: flown.output
    )
    flown.process.send_signal(signal.SIGINT)
    if times == 2:
        eventually(
            lambda: any("SIGTERM" in (run / "events.jsonl").read_text() for run in flown.runs),
            60,
            "it begins to land",
        )
        flown.process.send_signal(signal.SIGINT)
    assert flown.wait() == 130, flown.output
    assert "interrupted: 2 of 2" in flown.output
    assert_nothing_left(flown, temporary)


@pytest.mark.flight
def test_arena_that_does_not_start_is_a_failed_result(smoke: Any, temporary: Path, tmp_path: Path):
    (tmp_path / "quits.smoke.yaml").write_text(
        "arena: {vehicles: {uav1: {autopilot: builtin, tools: {broken: {argv: [/does/not/exist]}}}}}\n"
        "steps:\n  - expect: uav1.airborne within 3 s\n"
    )
    flown = smoke(str(tmp_path / "quits.smoke.yaml"))
    assert flown.wait() == 1, flown.output
    text = " ".join(flown.output.split())
    assert (
        "the arena did not start (exit 2)" in text
        and "'/does/not/exist' was not found on this computer" in text
    )
    assert_nothing_left(flown, temporary)


@pytest.mark.flight
def test_scripted_flight_is_led_by_a_test(arena_run: Any):
    with arena_run.up(SHIPPED / "one.yaml") as flight:
        flight.always("inside geofence")
        flight.until("uav1.airborne + 2 s", 30)
        flight.do("kill supervisor")
        flight.expect("supervisor is EXITED within 1 s")
        flight.do("hang router for 500 ms")
        with pytest.raises(AssertionError, match=r"uav1.mode was .* expected uav1.mode == TAKEOFF"):
            flight.expect("uav1.mode == TAKEOFF within 200 ms")
        flight.expect("uav1.landed within 15 s")
        assert abs(flight.vehicle("uav1").p_n[0]) < 2.0 and flight.vehicle("uav1").down
        run = flight.session.run
    assert started_by(run) == set()
