"""Tests of the tools that arena knows by name, with stand-ins on PATH: MAVROS, the bag recorder and QGroundControl."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from .flight import PROGRAMS, Hangar

pytestmark = pytest.mark.flight

ARENA = """
address: {address}
defaults: {{autopilot: builtin, tools: {{mavros: {{domain: 7}}}}}}
tools: {{bag: {{domain: 7}}, qgroundcontrol: {{command: QGroundControl}}}}
vehicles:
  uav1: {{program: {{path: '{program}', args: [lands], needs: [tool.bag, tool.qgroundcontrol, tool.uav1.mavros]}}}}
"""
GROUND_STATION = """
import socket
with socket.socket(type=socket.SOCK_DGRAM) as sock:
    sock.bind(("{address}", 14550))
    while sock.recv(65535):
        pass
"""


@pytest.fixture
def path(tmp_path: Path, hangar: Hangar, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder of PATH with the stand-ins, and a ROS 2 workspace with the packages."""
    folder, index = tmp_path / "bin", tmp_path / "ros/share/ament_index/resource_index/packages"
    for each in (folder, index):
        each.mkdir(parents=True)
    for name in ("mavros", "ros2bag"):
        (index / name).touch()
    (tmp_path / "ground_station.py").write_text(GROUND_STATION.format(address=hangar.address))
    scripts = {"ros2": PROGRAMS / "ros2_stand_in.py", "QGroundControl": tmp_path / "ground_station.py"}
    for name, script in scripts.items():
        (folder / name).write_text(f'#!/bin/sh\nexec {sys.executable} {script} "$@"\n')
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    return folder


def test_program_flies_beside_mavros_a_bag_recorder_and_qgroundcontrol(hangar: Hangar, path: Path) -> None:
    file = hangar.folder / "arena.yaml"
    file.write_text(ARENA.format(address=hangar.address, program=PROGRAMS / "fly.py"))
    flight = hangar.up(file, "--until-done", "--speed", "3")
    assert flight.wait(120) == 0, flight.said()
    reasons = {
        name: [e["reason"] for e in flight.events(name) if e.get("to") == "READY"]
        for name in ("tool.uav1.mavros", "tool.bag", "tool.qgroundcontrol")
    }
    assert "uav1.mavros.mavros]: CON: Got HEARTBEAT, connected" in reasons["tool.uav1.mavros"][0]
    assert "Recording... (domain 7)" in reasons["tool.bag"][0]
    assert reasons["tool.qgroundcontrol"] == ["serves port 14550"]
    assert (flight.folder / "bag" / "metadata.yaml").exists()
    flight.assert_nothing_left()


def test_missing_mavros_is_reported_before_anything_starts(hangar: Hangar, path: Path) -> None:
    (path.parent / "ros/share/ament_index/resource_index/packages/mavros").unlink()
    file = hangar.folder / "arena.yaml"
    file.write_text(ARENA.format(address=hangar.address, program=PROGRAMS / "fly.py"))
    flight = hangar.up(file, "--until-done")
    assert flight.wait(60) == 2
    assert (
        "vehicles.uav1.tools.mavros: the ROS 2 package mavros was not found on this computer" in flight.said()
    )
    assert not list(flight.runs.glob("*"))
