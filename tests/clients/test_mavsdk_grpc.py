"""Test of a MAVSDK-Python 3 program (package mavsdk-grpc) that waits for a global position and a home."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from end_to_end.flight import PATIENCE

from .site import Site

pytestmark = pytest.mark.flight
pytest.importorskip("mavsdk_grpc", reason="client is not installed: mavsdk-grpc")
PX4_VEHICLE = ", gps: true, forward: false"
"""MAVSDK needs a global position: PX4 gives one with GPS only, the built-in autopilot with external vision too."""
PROGRAM = Path(__file__).parent / "take_off_and_land.py"


def test_mavsdk_grpc_takes_off_and_lands(site: Site) -> None:
    site.ready()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    argv = [sys.executable, str(PROGRAM), site.sdk_url, str(port)]
    ran = subprocess.Popen(
        argv, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    try:
        said, _ = ran.communicate(timeout=PATIENCE * 120)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(ran.pid, signal.SIGKILL)  # its server with it
        ran.wait()
    assert ran.returncode == 0, said
    assert json.loads(said.splitlines()[-1])["highest_m"] > 1.0
    site.down()
