"""Two arenas on one computer: a default address moves, an explicit one does not."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

TEXT = "name: lab\nvehicles: {uav1: {autopilot: builtin}}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arena.yaml").write_text(TEXT)
    return tmp_path


def arena(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "ARENA_RUNTIME_DIR": str(folder / "rt")}
    command = (sys.executable, "-m", "arena.cli", *arguments)
    return subprocess.run(
        command, cwd=folder, env=environment, text=True, capture_output=True, timeout=120, check=False
    )


def address_of(folder: Path, number: int) -> str:
    """Return the address of the run that was started as this one."""
    plans = sorted((folder / "runs").glob("*/arena.yaml"), key=lambda path: path.stat().st_mtime)
    return plans[number].read_text().partition("address: ")[2].split()[0]


@pytest.mark.flight
def test_arenas_that_start_at_the_same_moment_take_different_addresses(folder: Path) -> None:
    try:
        with ThreadPoolExecutor(2) as pool:
            done = list(pool.map(lambda _: arena(folder, "up", "--detach", "--no-report"), range(2)))
        assert [one.returncode for one in done] == [0, 0], "".join(one.stdout + one.stderr for one in done)
        assert address_of(folder, 0) != address_of(folder, 1)
    finally:
        for run in sorted((folder / "runs").glob("*")):
            arena(folder, "down", "--run", str(run))


@pytest.mark.flight
def test_second_arena_takes_the_next_free_loopback_address(folder: Path) -> None:
    try:
        first = arena(folder, "up", "--detach", "--no-report")
        assert first.returncode == 0, first.stdout + first.stderr
        taken = address_of(folder, 0)
        checked = arena(folder, "check")
        assert checked.returncode == 0, checked.stdout + checked.stderr
        assert f"{taken} is in use by run {folder}/runs/" in checked.stdout
        second = arena(folder, "up", "--detach", "--no-report")
        assert second.returncode == 0, second.stdout + second.stderr
        assert f"{taken} is in use by run {folder}/runs/" in second.stdout
        assert f": using {address_of(folder, 1)}\n" in second.stdout
        assert address_of(folder, 1) != taken
        explicit = arena(folder, "up", "--detach", "--no-report", "--set", f"address={taken}")
        assert explicit.returncode == 1 and f"is running on {taken}" in explicit.stderr
        pulled = arena(folder, "params", "pull")
        assert (
            pulled.returncode == 2
            and "2 running arenas were started from this file. Choose one: " in pulled.stderr
        )
    finally:
        for run in sorted((folder / "runs").glob("*")):
            arena(folder, "down", "--run", str(run))
