"""Whole arenas: each test has an address and a runtime folder of its own, so that two can fly side by side."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from arena.schema.px4 import find_px4

from .flight import Hangar
from .process_table import Sorties

_count = itertools.count(1)


def own_address() -> str:
    """127.58.x.y: no other test of this process, and hardly one of another, has it."""
    return f"127.58.{os.getpid() % 250 + 1}.{next(_count)}"


@pytest.fixture
def hangar(tmp_path: Path) -> Iterator[Hangar]:
    made = Hangar(tmp_path, own_address())
    yield made
    made.close()


@pytest.fixture(scope="module")
def shared_hangar(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hangar]:
    """For one arena that several tests look at."""
    made = Hangar(tmp_path_factory.mktemp("flight"), own_address())
    yield made
    made.close()


@pytest.fixture(scope="module")
def flown_sorties(tmp_path_factory: pytest.TempPathFactory) -> Sorties:
    return Sorties(lambda: Hangar(tmp_path_factory.mktemp("sortie"), own_address()))


@pytest.fixture
def sorties(request: pytest.FixtureRequest, flown_sorties: Sorties) -> Sorties:
    """Of this module: what flies for one cell is asked by all that share it."""
    if request.node.get_closest_marker("px4") is not None:
        found = find_px4()
        if found is None or found.stand_in:
            pytest.skip("no PX4 is found: set PX4_HOME")
    return flown_sorties
