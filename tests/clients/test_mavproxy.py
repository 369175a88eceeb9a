"""Tests with MAVProxy as a person uses it: commands typed in, output read.

MAVProxy 1.8 passes PX4 modes to pymavlink as tuples, which fails before anything is sent; so its `long` command is used.
"""

from __future__ import annotations

import importlib.util
import math
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from end_to_end.flight import end_with_us, eventually

from .site import Site

pytestmark = pytest.mark.flight
if importlib.util.find_spec("MAVProxy") is None:
    pytest.skip("client is not installed: MAVProxy", allow_module_level=True)


class Console:
    """A MAVProxy process connected to the vehicle's tools port."""

    def __init__(self, site: Site, folder: Path) -> None:
        beside = Path(sys.executable).parent / "mavproxy.py"
        script = str(beside) if beside.exists() else shutil.which("mavproxy.py")
        assert script, "MAVProxy has no command"
        argv = [
            sys.executable,
            script,
            f"--master=udpout:{site.tools}",
            "--source-system=239",
            "--nowait",
            "--force-connected",
        ]
        self._process = subprocess.Popen(
            argv,
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=end_with_us,  # noqa: PLW1509  nothing else is done in it
        )
        self.said = ""
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self.said += line

    def type(self, command: str) -> None:
        assert self._process.stdin
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def until(self, words: str, limit_s: float = 30.0) -> None:
        eventually(lambda: words in self.said, limit_s, f"MAVProxy says {words!r}", lambda: self.said[-3000:])

    def ask(self, command: str, words: str, limit_s: float = 30.0) -> None:
        """Type a command and wait for matching output."""
        before = len(self.said)
        self.type(command)
        eventually(
            lambda: words in self.said[before:], limit_s, f"{command}: {words!r}", lambda: self.said[-3000:]
        )

    def insist(self, command: str, pattern: str, limit_s: float = 30.0) -> None:
        """Repeat a command every 2 s until the output matches."""
        before, typed = len(self.said), -math.inf

        def told() -> bool:
            nonlocal typed
            if time.monotonic() - typed > 2.0:
                typed = time.monotonic()
                self.type(command)
            return re.search(pattern, self.said[before:]) is not None

        eventually(told, limit_s, f"{command}: {pattern!r}", lambda: self.said[-3000:])

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join(5.0)


@pytest.fixture
def console(site: Site, tmp_path: Path) -> Iterator[Console]:
    site.ready()
    made = Console(site, tmp_path)
    made.until("online system", 40)
    yield made
    made.close()


def test_mavproxy_reads_and_sets_parameters(console: Console) -> None:
    console.until("Received ", 90)
    console.type("param set MPC_XY_CRUISE 4")
    console.insist("param show MPC_XY_CRUISE", r"MPC_XY_CRUISE\s+4\.0")
    console.type("param set SYS_FAILURE_EN 1")
    console.insist("param show SYS_FAILURE_EN", r"SYS_FAILURE_EN\s+1")


def test_mavproxy_arms_takes_off_holds_and_lands(console: Console, site: Site) -> None:
    console.type("param set MIS_TAKEOFF_ALT 1.5")
    console.ask("long DO_SET_MODE 1 4 2", "Mode TAKEOFF")
    console.ask("arm throttle", "ARMED")
    site.flight.until_up(1.0, 30)
    console.until("Mode LOITER", 20)
    console.ask("long NAV_LAND", "Mode LAND")
    console.until("DISARMED", 40)
    site.down()


def test_mavproxy_uploads_and_flies_a_mission(console: Console, site: Site, tmp_path: Path) -> None:
    lat, lon = 47.397742, 8.545594
    north = lat + math.degrees(2.0 / 6_371_000.0)
    rows = [(22, 0.0, lat, 3.0), (16, 0.4, north, 3.0), (21, 0.0, lat, 0.0)]
    lines = [
        f"{k}\t0\t3\t{cmd}\t0\t{p2}\t0\t0\t{at}\t{lon}\t{up}\t1" for k, (cmd, p2, at, up) in enumerate(rows)
    ]
    (tmp_path / "mission.txt").write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    console.ask("wp load mission.txt", "Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
    console.ask("wp list", "Saved 3 waypoints")
    console.insist(
        "long MISSION_START 0 0", "Mode MISSION"
    )  # refused until it is checked, which is after its acknowledgement
    site.flight.until_up(1.0, 30)
    eventually(lambda: site.position()[0] > 1.4, 30, "north", site.position)
    console.until("DISARMED", 60)
    site.down()
