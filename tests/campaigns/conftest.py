"""Fixtures of the campaign tests: a small arena, and sweep files over it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from arena.campaign.design import Flight
from arena.campaign.store import Record
from arena.campaign.sweep import Sweep, load_sweep

ARENA = """\
world: {size: [10, 10, 4]}
defaults: {autopilot: builtin}
vehicles:
  uav1: {program: fly.py}
"""


@pytest.fixture
def sweep_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write a sweep file with this text, next to the arena and the program that it names."""
    (tmp_path / "arena.yaml").write_text(ARENA)
    (tmp_path / "fly.py").write_text("")

    def write(text: str) -> Path:
        path = tmp_path / "sweep.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def sweep_of(sweep_file: Callable[[str], Path]) -> Callable[[str], Sweep]:
    """Load a sweep over the small arena."""

    def load(text: str) -> Sweep:
        return load_sweep(sweep_file(f"arena: arena.yaml\n{text}"))

    return load


def record(id_: str, number: int = 1, *, passed: bool = True, **more: object) -> Record:
    """Return the record of a flight."""
    given = {"seed": 1, "settings": {}, "reasons": () if passed else ("it fell",), **more}
    return Record(id=id_, number=number, passed=passed, **given)  # type: ignore[arg-type]


def record_of(flight: Flight, **more: object) -> Record:
    """Return the record of this flight."""
    given = {"seed": flight.seed, "settings": dict(flight.settings), **more}
    return record(flight.id, flight.number, **given)  # type: ignore[arg-type]
