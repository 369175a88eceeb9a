"""Fixtures and hooks of the whole test suite."""

from __future__ import annotations

import gc
import os
import pty
import re
import shutil
import subprocess
import sys
import tempfile
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Every run draws the same examples, so that a failure comes from the change under test. HYPOTHESIS_PROFILE=hunt draws new ones.
# No example has a time limit: a busy machine would exceed it.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("hunt", derandomize=False, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

os.umask(0o022)  # runtime folders that a group may write are ignored

COUNTED = {"px4": "real PX4", "browser": "real browser", "fastdds": "Fast DDS"}
"""Marks of tests that are counted in the summary, because they need something that a computer may not have -> its name there."""
FILE_MARKS = ("flight", "crowd", "alone")
"""Marks that stand in the file of their tests, so that other files need not be imported to select them."""
_FILE_WITH_MARKS = re.compile(r"^pytestmark = .*", re.MULTILINE)
"""Line of a test file that gives marks to all its tests."""


@pytest.fixture(autouse=True)
def no_px4_by_chance(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Hide an installed PX4 from tests that are not marked px4, so that `autopilot: auto` is the built-in one."""
    if request.node.get_closest_marker("px4") is None:
        monkeypatch.delenv("PX4_HOME", raising=False)


SLOWEST_FILES = (
    "end_to_end/test_chaos.py",
    "end_to_end/test_mixed_fleet.py",
    "smoke/test_flights.py",
    "end_to_end/test_px4.py",
    "end_to_end/test_monitor.py",
    "end_to_end/test_land_all.py",
    "end_to_end/test_fused.py",
    "end_to_end/test_copilot.py",
    "clients/test_mavsdk.py",
    "end_to_end/test_process_air.py",
    "end_to_end/test_signals.py",
    "end_to_end/test_failing_backends.py",
    "end_to_end/test_hitl.py",
    "end_to_end/test_two_quads.py",
    "end_to_end/test_supervisor_killed.py",
    "end_to_end/test_failing_programs.py",
    "uav/test_vehicle_control.py",
    "autopilot/test_steady_flights.py",
    "emergency/test_direct_link.py",
    "smoke/test_forked_arena.py",
    "emergency/test_land_all.py",
    "supervisor/test_commands.py",
    "params/test_session.py",
    "supervisor/test_loop.py",
    "supervisor/test_shutdown.py",
    "campaigns/test_campaign.py",
    "cli/test_params_transfer.py",
    "supervisor/test_loop_end.py",
    "report/test_page_in_a_browser.py",
    "autopilot/test_manual_modes.py",
    "end_to_end/test_arm_permit.py",
    "sim/test_loop.py",
    "supervisor/test_landing_without_files.py",
    "fcu_link/test_axes_check.py",
    "fcu_link/test_fcu_link_shell.py",
    "supervisor/test_fork_client.py",
)
"""Test files that take longest, in this order. They begin first, so that no worker flies alone at the end of the suite. Of the unit
tests, every second one waits and the others compute. A worker that gets a file with one or two tests gets the next file with it."""


def names_mark(text: str, mark: str) -> bool:
    """Return whether the source of a test file, or a line of it, uses a mark."""
    return f"mark.{mark}" in text


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Ignore files from which `-m` selects no test, so that they need not be imported.

    `flight and ...` selects no test of a file that does not name this mark, and `not flight and ...` no test of a file that gives
    this mark to all its tests.
    """
    expression = str(config.getoption("markexpr"))
    is_test = collection_path.name.startswith("test_") and collection_path.suffix == ".py"
    if not is_test or " or " in expression or "(" in expression:
        return None
    terms = expression.split(" and ")
    text = collection_path.read_text()
    everywhere = "".join(_FILE_WITH_MARKS.findall(text))
    for mark in FILE_MARKS:
        if (mark in terms and not names_mark(text, mark)) or (
            f"not {mark}" in terms and names_mark(everywhere, mark)
        ):
            return True
    return None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect tests without the garbage collector: it would search all imported modules again and again, and find nothing."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)  # before tests are deselected
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the slowest files first, and record which tests are marked px4 or browser; keywords would also match folder names."""
    for path, mark in {(i.path, mark) for i in items for mark in FILE_MARKS if i.get_closest_marker(mark)}:
        assert names_mark(path.read_text(), mark), (
            f"{path}: its tests have the mark {mark}, which must stand in this file"
        )
    place = {name: number for number, name in enumerate(SLOWEST_FILES)}
    here = Path(__file__).parent
    places = {p: place.get(p.relative_to(here).as_posix(), len(place)) for p in {item.path for item in items}}
    items.sort(key=lambda item: places[item.path])
    for item in items:
        for mark in COUNTED:
            if item.get_closest_marker(mark) is not None:
                item.user_properties.append(("marked", mark))


@pytest.fixture
def runtime_dir(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Give a private runtime folder with a path short enough for sockets."""
    folder = Path(tempfile.mkdtemp(prefix="arena-test-"))
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(folder))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def serial_cable() -> Iterator[tuple[str, str]]:
    """Give the two devices of a simulated serial cable."""
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
    """Print how many tests ran on a real PX4 and in a real browser, and how many did not."""

    def count(mark: str, *kinds: str) -> int:
        reports = (r for kind in kinds for r in terminalreporter.stats.get(kind, []))
        return sum(("marked", mark) in getattr(r, "user_properties", ()) for r in reports)

    for mark, words in COUNTED.items():
        ran, did_not = count(mark, "passed", "failed"), count(mark, "skipped")
        terminalreporter.write_line(f"{words}: {ran} tests ran, {did_not} did not")
