"""A running arena without programs: `arena fly` along a file, `arena.connect` in an event loop, `arena shell`, refusals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.flight
LIMIT_S = 90.0
NOTEBOOK = """
import asyncio, arena, numpy as np
async def cell():  # as a cell of Jupyter, which runs in an event loop
    uav = arena.connect("uav1")
    assert uav.hold_until(lambda: uav.info.is_connected, 20)
    first = uav.clock.now()
    print("height", round(-float(uav.ekf.pos[2]), 1), "armed", uav.info.is_armed)
    uav.clock.sleep_until(first + 0.5)
    assert uav.clock.now() >= first + 0.5
    try:
        arena.connect("uav1")
    except Exception as error:
        print("second:", type(error).__name__)
    uav.close()
asyncio.run(cell())
"""


def circle(folder: Path, radius_m: float = 0.6) -> Path:
    import math

    lines = ["t,north,east,down,yaw"]
    for k in range(121):
        t = 0.05 * k
        angle = 2 * math.pi * (10 * (t / 6) ** 3 - 15 * (t / 6) ** 4 + 6 * (t / 6) ** 5)
        lines.append(
            f"{t:.2f},{radius_m * (math.cos(angle) - 1):.4f},{radius_m * math.sin(angle):.4f},-1.0,0.3"
        )
    file = folder / "circle.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


class RunningArena:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.env = {**os.environ, "ARENA_RUNTIME_DIR": str(folder / "rt")}
        (folder / "rt").mkdir(mode=0o700)
        file = folder / "arena.yaml"
        file.write_text(
            f"name: fly\naddress: 127.63.{os.getpid() % 250 + 1}.1\nworld: {{size: [6, 5, 3]}}\n"
            "vehicles:\n  uav1: {autopilot: builtin}\n"
        )
        self.out = (folder / "up.txt").open("wb")
        command = [sys.executable, "-m", "arena", "up", str(file), "--headless", "--speed", "max"]
        self.up = subprocess.Popen(
            [*command, "--no-report"], cwd=folder, env=self.env, stdout=self.out, stderr=subprocess.STDOUT
        )

    def run(self, *command: str, code: int = 0, given: str = "") -> str:
        done = subprocess.run(
            [sys.executable, *command],
            check=False, cwd=self.folder, env=self.env, input=given, capture_output=True, text=True, timeout=LIMIT_S,
        )  # fmt: skip
        said = done.stdout + done.stderr
        assert done.returncode == code, (
            f"{command}: exit code {done.returncode}\n{said}\n{(self.folder / 'up.txt').read_text()}"
        )
        return said

    def wait(self) -> None:
        deadline = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline:
            done = subprocess.run(
                [sys.executable, "-m", "arena", "fly", "uav1", "circle.csv", "--check"],
                cwd=self.folder, env=self.env, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode == 0:
                return
            assert self.up.poll() is None, (self.folder / "up.txt").read_text()
        raise AssertionError(f"the arena is not up: {done.stderr}")

    def close(self) -> None:
        self.up.send_signal(signal.SIGINT)
        try:
            self.up.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            self.up.kill()
            self.up.wait()
        self.out.close()


@pytest.fixture(scope="module")
def arena(tmp_path_factory) -> Iterator[RunningArena]:
    folder = tmp_path_factory.mktemp("f")
    circle(folder)
    running = RunningArena(folder)
    try:
        running.wait()
        yield running
    finally:
        running.close()


def test_file_is_flown_and_the_vehicle_lands(arena):
    said = arena.run("-m", "arena", "fly", "uav1", "circle.csv")
    assert "uav1: landed and disarmed" in said
    assert (
        "armed"
        not in arena.run("-m", "arena", "ps").replace("disarmed", "").split("uav1", 1)[1].splitlines()[0]
    )


def test_file_that_leaves_the_room_is_refused_before_arming(arena):
    circle(arena.folder, radius_m=1.6)
    try:
        said = arena.run("-m", "arena", "fly", "uav1", "circle.csv", code=2)
    finally:
        circle(arena.folder)
    assert "outside the room" in said and "take-off" not in said


def test_session_in_an_event_loop_reads_the_vehicle_and_keeps_others_out(arena):
    said = arena.run("-c", NOTEBOOK)
    assert "height 0.0 armed False" in said or "height 0.1 armed False" in said
    assert "second: InputError" in said


def test_shell_flies_and_lands_when_it_is_left(arena):
    given = "uav.start_offboard_mission()\nuav.set_pos_yaw([0, 0, -0.6], 0, 3)\nprint('up', round(-uav.ekf.pos[2], 1))\n"
    said = arena.run("-m", "arena", "shell", "uav1", given=given)
    assert "uav1: landed and disarmed" in said or "left OFFBOARD" in said, said


def test_hand_flight_needs_a_terminal(arena):
    assert "terminal" in arena.run("-m", "arena", "fly", "uav1", code=2)
