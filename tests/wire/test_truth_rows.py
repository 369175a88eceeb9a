"""Plain numbers of the truth page: the same as the arrays, without numpy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arena.errors import RunError, WireError
from arena.geometry import quat_from_euler
from arena.wire.truth_page import Truth, TruthReader, TruthWriter
from arena.wire.truth_rows import StateReader

GROUPS = ("p_n", "q_nb", "v_n", "omega_b")
VEHICLES = 3


def random_truth(time_s: float, rng: np.random.Generator) -> Truth:
    p_n, v_n, omega_b, accel_b = rng.normal(size=(4, VEHICLES, 3))
    return Truth(
        time_s=time_s,
        p_n=p_n,
        q_nb=np.array([quat_from_euler(rng.normal(size=3)) for _ in range(VEHICLES)]),
        v_n=v_n,
        omega_b=omega_b,
        accel_b=accel_b,
        motors=rng.uniform(size=(VEHICLES, 4)),
    )


class Page:
    """Truth page of three vehicles, which `write` extends by random states."""

    def __init__(self, path: Path) -> None:
        self.path, self._count, self._rng = path, 0, np.random.default_rng(5)
        self._writer = TruthWriter(path, VEHICLES, period_s=0.004)

    def write(self, count: int) -> None:
        for _ in range(count):
            self._writer.write(random_truth(0.004 * self._count, self._rng))
            self._count += 1


@pytest.fixture
def page(tmp_path):
    made = Page(tmp_path / "truth")
    made.write(100)
    return made


@pytest.mark.parametrize("time_s", [None, 0.2, 0.3001, 0.3905, 0.396])
def test_numbers_are_those_of_the_arrays(page, time_s):
    arrays, numbers = TruthReader(page.path), StateReader(page.path)
    expected = arrays.newest() if time_s is None else arrays.at(time_s)
    found = numbers.newest() if time_s is None else numbers.at(time_s)
    assert found.time_s == expected.time_s
    for group in GROUPS:
        assert [row.tolist() for row in getattr(found, group)] == getattr(expected, group).tolist()


def test_numbers_that_were_read_stay_when_the_world_writes_on(page):
    reader = StateReader(page.path)
    kept = []
    for time_s in (None, 0.3001):
        found = reader.newest() if time_s is None else reader.at(time_s)
        before = found.p_n[1].tolist()
        assert len(before) == 3
        kept.append((found, before))
    page.write(1000)  # more than the page holds
    for found, before in kept:
        assert found.p_n[1].tolist() == before
        assert reader.newest().p_n[1].tolist() != before


def test_a_time_outside_the_page_gives_none(page):
    reader = StateReader(page.path)
    assert reader.at(-0.1) is None
    assert reader.at(0.5) is None


def test_a_missing_short_or_foreign_page_is_an_error_in_one_sentence(tmp_path):
    for content in (None, b"", bytes(8), bytes(13)):
        if content is not None:
            (tmp_path / "truth").write_bytes(content)
        with pytest.raises(RunError, match="is the process `world` running"):
            StateReader(tmp_path / "truth")
    (tmp_path / "truth").write_bytes(bytes(800))
    with pytest.raises(WireError, match="is not a truth page of this version"):
        StateReader(tmp_path / "truth")


def test_recorder_starts_without_numpy():
    """The import of numpy costs more CPU time than five seconds of a recorded flight."""
    code = (
        "import sys, arena.recorder.__main__, arena.recorder.viewer_setup, arena.mocap.natnet.client, "
        "arena.wire.truth_rows; print('numpy' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
