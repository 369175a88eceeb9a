"""The rules that judge a flight with random faults: each violation is found."""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks.chaos import read
from benchmarks.chaos_flight.disk import in_namespace, mount_namespace
from benchmarks.chaos_flight.faults import DISK_FAULTS, draw
from benchmarks.chaos_flight.radio import Received
from benchmarks.chaos_flight.record import Record, Strike, table
from benchmarks.chaos_flight.verdict import Observed, landed_names, violations
from tests.end_to_end.chaos_seeds import DAILY

LAND = Received(at=12.0, sender=(253, 200), what="mode AUTO.LAND")
SETPOINT = Received(at=12.0, sender=(1, 191), what="setpoint")


@pytest.mark.parametrize(
    ("observed", "text"),
    [
        (Observed(name="uav1", armed_at_end=True), "uav1: left armed"),
        (Observed(name="uav1", armed_without_permit=True), "uav1: armed without a permit"),
        (
            Observed(name="uav1", false_landings=["uav1: landed"]),
            "uav1: reported as landed while armed: uav1: landed",
        ),
        (Observed(name="uav1", to_stranger=[LAND]), "uav1: mode AUTO.LAND from 253/200 to another uid"),
        (
            Observed(name="uav1", pilot_since=10.0, received=[LAND]),
            "uav1: mode AUTO.LAND from 253/200 2.0 s after the pilot took over",
        ),
    ],
)
def test_each_violation_is_found(observed, text):
    assert violations([observed]) == [text]


def test_run_that_does_not_end_is_a_violation():
    assert violations([], ended=False) == ["the run did not end"]


@pytest.mark.parametrize(
    "observed",
    [
        Observed(name="uav1", armed_at_end=True, declared=True),
        Observed(name="uav1", pilot_since=11.8, received=[LAND]),
        Observed(name="uav1", pilot_since=10.0, pilot_until=11.0, received=[LAND]),
        Observed(name="uav1", pilot_since=10.0, received=[SETPOINT]),
        Observed(name="uav1", received=[LAND]),
    ],
)
def test_what_is_allowed_is_no_violation(observed):
    assert violations([observed]) == []


def test_texts_of_land_all_name_the_landed_vehicles():
    text = (
        "uav1: landed and disarmed after 3.2 s\nuav2: NOT CONFIRMED: armed\nland: uav3: already on the ground"
    )
    assert landed_names(text) == {"uav1", "uav3"}


def test_a_seed_always_gives_the_same_faults():
    assert draw(7) == draw(7) and len({str(draw(seed)) for seed in range(100)}) == 100


def test_share_of_the_flights_with_a_disk_fault_is_as_stated():
    kinds = [{fault.what for fault in draw(seed).faults} for seed in range(1000)]
    for kind, share in DISK_FAULTS.items():
        assert abs(sum(kind in found for found in kinds) / 1000 - share) < 0.05


def record(seed: int = 3, **changes) -> Record:
    strikes = [
        Strike(what="kill", target="router", at=1.0, airborne=True),
        Strike(what="kill", target="link.uav1", at=2.0, airborne=True, worked=False),
        Strike(what="full disk", target="", at=3.0),
    ]
    given = {
        "seed": seed, "script": "text", "late": "", "end": "Ctrl-C", "why": [], "took_off": 2, "airborne": 1,
        "strikes": strikes, "takeovers": 1, "landed": 2, "forgotten": [], "restarts": 1, "exit_code": 0, "lasted_s": 20.0,
    }  # fmt: skip
    return Record(**{**given, **changes})


def test_table_counts_faults_that_were_carried_out_and_that_struck_in_the_air():
    text = table([record(), record(4, why=["uav1: left armed"])])
    assert "| kill | 4 | 2 | 2 | 1 |" in text
    assert "| full disk | 2 | 2 | 0 | 1 |" in text
    assert "| end: Ctrl-C | 2 | - | - | 1 |" in text
    assert "2 flights, 1 with a violation" in text and "2 vehicles, in 2 flights" in text
    assert "seed 4: uav1: left armed" in text


def test_records_survive_a_broken_last_line(tmp_path):
    file = tmp_path / "records"
    file.write_text(record().to_json() + "\n" + record(4).to_json()[:50])
    assert read(file) == [record()]


FILL = """
import sys
from pathlib import Path
from benchmarks.chaos_flight.disk import SmallDisk
disk = SmallDisk.mount(Path(sys.argv[1]) / "runs", may_hang=False)
(disk.folder / "log").write_text("before")
print(disk.fill())
try:
    (disk.folder / "new").write_text("does not fit")
except OSError as error:
    print(error.strerror)
disk.free()
(disk.folder / "log").write_text("after")
disk.close(Path(sys.argv[1]) / "copy")
"""


def test_small_disk_is_really_full_and_its_files_are_kept(tmp_path):
    if not (namespace := mount_namespace()):
        pytest.skip("this system allows no mount namespace")
    command = in_namespace(namespace, [sys.executable, "-c", FILL, str(tmp_path)])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["True", "No space left on device"], done.stderr
    assert (tmp_path / "copy" / "log").read_text() == "after"
    assert not list((tmp_path / "runs").iterdir())


def kinds_of(seed: int) -> set[tuple[str, str]]:
    """Return (fault, process without its vehicle) of one flight, its end, whether a vehicle joins late, and lost links."""
    script = draw(seed)
    found = {("end", script.end)} | ({("late", "")} if script.late else set())
    targets = {fault: fault.target.replace("uav1", "uav").replace("uav2", "uav") for fault in script.faults}
    lost = {("unplug", "for ever") for fault in script.faults if fault.what == "unplug" and not fault.for_s}
    return found | lost | {(fault.what, target) for fault, target in targets.items()}


def test_daily_flights_have_every_fault_and_every_end():
    daily, every = (set().union(*map(kinds_of, seeds)) for seeds in (DAILY, range(1, 1001)))
    assert daily == every
