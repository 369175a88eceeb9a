"""What the whole suite shares."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def no_px4_by_chance(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """`autopilot: auto` means the built-in one in tests, whatever this machine has; tests marked px4 look for the real one."""
    if "px4" not in request.keywords:
        monkeypatch.delenv("PX4_HOME", raising=False)


@pytest.fixture
def runtime_dir(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A runtime folder of this test's own, with a path short enough for sockets: no test meets another's arena, or a user's."""
    folder = Path(tempfile.mkdtemp(prefix="arena-test-"))
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(folder))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tests that need a real PX4 are counted, never skipped in silence."""
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if "px4" in getattr(r, "keywords", {})]
    ran = [r for r in terminalreporter.stats.get("passed", []) if "px4" in getattr(r, "keywords", {})]
    terminalreporter.write_line(f"real PX4: {len(ran)} tests ran, {len(skipped)} did not")
