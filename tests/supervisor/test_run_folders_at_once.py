"""Arenas that start at the same moment: each gets a run folder and a runtime folder of its own."""

from __future__ import annotations

import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor

from arena.supervisor import create
from tests.supervisor.conftest import plan_of

ARENAS, AT_S = 24, 1_700_000_000.0


def test_arenas_of_the_same_second_and_name_do_not_meet(tmp_path, monkeypatch):
    runtime = tempfile.TemporaryDirectory(prefix="arena-test-")  # paths of sockets must be short
    monkeypatch.setenv("ARENA_RUNTIME_DIR", runtime.name)
    ready = threading.Barrier(ARENAS)

    def start(number):
        ready.wait()
        return create(plan_of(), tmp_path / f"runs{number % 2}", AT_S)

    with runtime, ThreadPoolExecutor(ARENAS) as pool:
        made = list(pool.map(start, range(ARENAS)))
        assert all((one.rt / "run").read_text() == str(one.path) for one in made)
        assert all(one.rt.stat().st_mode & 0o777 == 0o700 for one in made)
    assert len({one.path for one in made}) == len({one.rt for one in made}) == ARENAS
