"""Two arenas on one computer: a default address moves, an explicit one does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from end_to_end.flight import eventually

from arena.plan import make_plan
from arena.run_dirs import starting_alone
from arena.schema import load_arena
from arena.supervisor import create

TEXT = "name: lab\nsim: {processes: one}\nvehicles: {uav1: {autopilot: builtin}}\n"


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
def test_arena_that_starts_at_the_same_moment_takes_another_address(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The test is the first arena: it has chosen its address, and has not yet created its runtime folder."""
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(folder / "rt"))
    monkeypatch.setenv("TMPDIR", str(folder))  # a lock of its own, so that no other test waits
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    first = make_plan(load_arena(folder / "arena.yaml"))
    runs, out = [], folder / "out.txt"
    try:
        with starting_alone(print), out.open("wb") as file:
            argv = (sys.executable, "-m", "arena.cli", "up", "--detach", "--no-report")
            second = subprocess.Popen(argv, cwd=folder, stdout=file, stderr=subprocess.STDOUT)
            waits = "waiting, because another arena is starting"
            eventually(lambda: waits in out.read_text(), 60, waits, out.read_text)
            runs.append(create(first, folder / "first"))
        assert second.wait(120) == 0, out.read_text()
        assert f"{first.address} is in use by run {runs[0].path}: using " in out.read_text()
    finally:
        for run in runs:
            run.close()
        for path in sorted((folder / "runs").glob("*")):
            arena(folder, "down", "--run", str(path))


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
        for option in ("--json", "-q"):
            said = arena(folder, "up", option, "--time-limit", "1", "--no-report")
            moved = f"{taken} is in use by run {folder}/runs/"
            assert moved in said.stderr and moved not in said.stdout, said.stdout
            assert option == "-q" or [json.loads(line) for line in said.stdout.splitlines()], "only JSON"
        pulled = arena(folder, "params", "pull")
        assert (
            pulled.returncode == 2
            and "2 running arenas were started from this file. Choose one: " in pulled.stderr
        )
    finally:
        for run in sorted((folder / "runs").glob("*")):
            arena(folder, "down", "--run", str(run))
