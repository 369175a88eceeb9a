"""A program in the manner of MAVSDK-Python 3, which lives on as mavsdk-grpc: it waits for a global position and a home."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from .site import Site

pytestmark = pytest.mark.flight
pytest.importorskip("mavsdk_grpc", reason="client is not installed: mavsdk-grpc")
PROGRAM = Path(__file__).parent / "take_off_and_land.py"


def test_it_takes_off_and_lands(site: Site) -> None:
    site.ready()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    ran = subprocess.run(
        [sys.executable, str(PROGRAM), site.sdk_url, str(port)], capture_output=True, text=True, timeout=120, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert json.loads(ran.stdout.splitlines()[-1])["highest_m"] > 1.0
    site.down()
