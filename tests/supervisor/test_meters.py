"""The real-time factor of a run, from the world's clock page."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from arena.supervisor.meters import RealTimeMeter
from arena.supervisor.run_folder import RunFolder

from .conftest import plan_of, world


class Page:
    """A clock page that a test writes."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "clock.page"

    def write(self, time_s: float) -> None:
        data = struct.pack("d", time_s).ljust(4096, b"\0")
        with self._file.open("r+b" if self._file.exists() else "wb") as file:
            file.write(data)


def meter(folder: Path, **slice_: Any) -> RealTimeMeter:
    plan = plan_of(world(), slices={"world.json": {"clock": "{rt}/clock", **slice_}})
    return RealTimeMeter(plan, RunFolder(path=folder, rt=folder))


def test_time_is_none_until_the_world_runs(tmp_path: Path) -> None:
    found, page = meter(tmp_path), Page(tmp_path)
    assert found.time_s() is None
    page.write(0.0)
    assert found.time_s() is None
    page.write(2.5)
    assert found.time_s() == 2.5


@pytest.mark.parametrize(("speed", "asked"), [(1.0, 1.0), (2, 2.0), ("max", None)])
def test_factor_is_simulated_time_over_time(tmp_path: Path, speed: object, asked: float | None) -> None:
    found, page = meter(tmp_path, speed=speed), Page(tmp_path)
    page.write(1.0)
    found.sample(100.0)
    assert found.result() is None, "too short to say"
    page.write(7.5)
    found.sample(110.0)
    assert found.result() == {"factor": 0.65, "asked": asked}


def test_without_a_world_the_time_is_that_since_the_start(tmp_path: Path) -> None:
    found = RealTimeMeter(plan_of(), RunFolder(path=tmp_path, rt=tmp_path))
    found.sample(100.0)
    assert (found.time_s() or 0.0) >= 0.0 and found.result() is None
