"""What the whole suite shares."""

from __future__ import annotations

import os
import pty
import shutil
import subprocess
import sys
import tempfile
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run: a failure is of the change that is tested. HYPOTHESIS_PROFILE=hunt looks for new ones.
settings.register_profile("same", derandomize=True)
settings.register_profile("hunt", derandomize=False)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


@pytest.fixture(autouse=True)
def no_px4_by_chance(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """`autopilot: auto` means the built-in one in tests, whatever this machine has; tests marked px4 look for the real one."""
    if request.node.get_closest_marker("px4") is None:
        monkeypatch.delenv("PX4_HOME", raising=False)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """By the mark and not by a keyword: folders' names are keywords too."""
    for item in items:
        if item.get_closest_marker("px4") is not None:
            item.user_properties.append(("marked", "px4"))


@pytest.fixture
def runtime_dir(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A runtime folder of this test's own, with a path short enough for sockets: no test meets another's arena, or a user's."""
    folder = Path(tempfile.mkdtemp(prefix="arena-test-"))
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(folder))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def serial_cable() -> Iterator[tuple[str, str]]:
    """The devices at the two ends of a cable."""
    ends = [pty.openpty(), pty.openpty()]
    for fd in (fd for end in ends for fd in end):
        tty.setraw(fd)
    inner = [master for master, _ in ends]
    argv = [sys.executable, str(Path(__file__).parent / "children" / "cable.py"), *map(str, inner)]
    cable = subprocess.Popen(argv, pass_fds=inner)
    near, far = (os.ttyname(slave) for _, slave in ends)
    yield near, far
    cable.kill()
    cable.wait()
    for fd in (fd for end in ends for fd in end):
        os.close(fd)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tests that need a real PX4 are counted, never skipped in silence."""

    def count(*kinds: str) -> int:
        reports = (r for kind in kinds for r in terminalreporter.stats.get(kind, []))
        return sum(("marked", "px4") in getattr(r, "user_properties", ()) for r in reports)

    ran, did_not = count("passed", "failed"), count("skipped")
    terminalreporter.write_line(f"real PX4: {ran} tests ran, {did_not} did not")
