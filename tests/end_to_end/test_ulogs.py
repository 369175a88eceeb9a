"""Logs (ULog) of PX4 and of the built-in autopilot on the same flight: fetched over MAVLink, and drawn on top of each other."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from pyulog import ULog

from .flight import ROOT, Hangar
from .test_px4 import flown_by_px4, real_px4

pytestmark = pytest.mark.flight


@pytest.mark.px4
def test_log_of_a_real_px4_is_fetched_and_overlays_that_of_the_built_in_autopilot(hangar: Hangar) -> None:
    flight = hangar.fly({"uav1": "lands", "uav2": "lands"}, *real_px4(), *flown_by_px4("uav1"))
    for name in ("uav1", "uav2"):  # the first may have landed before the other is in the air
        flight.until_said(f"{name}: in the air", 60)
    flight.until_disarmed(("uav1", "uav2"), 60)
    fetched = flight.cli(
        "log", "fetch", "uav1", "--arena", str(hangar.folder / "arena.yaml"), *flown_by_px4("uav1")
    )
    assert fetched.returncode == 0, fetched.stdout + fetched.stderr
    logs = [flight.folder / "ulog" / f"{name}.ulg" for name in ("uav1", "uav2")]
    copies = hangar.folder / "copies"
    again = flight.cli(
        *("log", "fetch", "uav2", "--arena", str(hangar.folder / "arena.yaml"), "-o", str(copies)),
        *flown_by_px4("uav1"),
    )
    assert again.returncode == 0, again.stdout + again.stderr
    assert (copies / "uav2.ulg").read_bytes() == logs[1].read_bytes(), "the built-in autopilot sends its file"
    (original,) = (flight.folder / "px4" / "uav1" / "log").glob("*/*.ulg")
    assert logs[0].read_bytes() == original.read_bytes()
    names = [{each.name for each in ULog(str(log)).data_list} for log in logs]
    assert not names[1] - names[0] - {"vehicle_magnetometer"}, "every topic of ours is one that PX4 logs"
    picture = flight.folder / "overlay.png"
    script = ROOT / "examples" / "13_overlay" / "overlay.py"
    drawn = subprocess.run(
        [sys.executable, str(script), *map(str, logs), "-o", str(picture)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert drawn.returncode == 0, drawn.stderr
    (difference,) = re.findall(r"differ by ([\d.]+) m", drawn.stdout)
    assert float(difference) < 0.3 and picture.stat().st_size > 50_000
