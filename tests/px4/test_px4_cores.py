"""CPU cores of PX4: it leaves the core that a fast world keeps to."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

ASK = """import os, sys
from arena.px4.__main__ import leave_core_of
leave_core_of(int(sys.argv[1]))
print(*sorted(os.sched_getaffinity(0)))"""
CORES = os.sched_getaffinity(0)


def left_by(world_cores: set[int]) -> set[int]:
    with subprocess.Popen(["sleep", "30"]) as world:
        try:
            os.sched_setaffinity(world.pid, world_cores)
            said = subprocess.run(
                [sys.executable, "-c", ASK, str(world.pid)], capture_output=True, text=True, check=True
            ).stdout
        finally:
            world.kill()
    return {int(core) for core in said.split()}


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_px4_leaves_the_core_of_a_world_that_keeps_one() -> None:
    core = max(CORES)
    assert left_by({core}) == CORES - {core}


def test_px4_uses_all_cores_when_the_world_does() -> None:
    assert left_by(CORES) == CORES
