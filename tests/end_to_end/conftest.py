"""Fixtures for tests of whole arenas: each has its own address and runtime folder, so that two can fly side by side."""

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
    """Return an address 127.58.x.y that no other test of this process uses."""
    return f"127.58.{os.getpid() % 250 + 1}.{next(_count)}"


def wants_report(request: pytest.FixtureRequest) -> bool:
    """Return whether the flights of a test module make a report with plots: only if the module has `REPORT = True`."""
    return bool(getattr(request.module, "REPORT", False))


def is_cold(request: pytest.FixtureRequest) -> bool:
    """Return whether new interpreters run `arena up` for a test module: only if the module has `COLD = True`."""
    return bool(getattr(request.module, "COLD", False))


@pytest.fixture
def hangar(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Hangar]:
    made = Hangar(tmp_path, own_address(), report=wants_report(request), cold=is_cold(request))
    yield made
    made.close()


@pytest.fixture(scope="module")
def shared_hangar(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Hangar]:
    """Give a hangar for an arena that all tests of a module share."""
    made = Hangar(
        tmp_path_factory.mktemp("flight"), own_address(), report=wants_report(request), cold=is_cold(request)
    )
    yield made
    made.close()


@pytest.fixture(scope="module")
def flown_sorties(tmp_path_factory: pytest.TempPathFactory) -> Sorties:
    return Sorties(lambda: Hangar(tmp_path_factory.mktemp("sortie"), own_address()))


@pytest.fixture
def sorties(request: pytest.FixtureRequest, flown_sorties: Sorties) -> Sorties:
    """Give the sorties of this module; cells of one sortie share one flight."""
    if request.node.get_closest_marker("px4") is not None:
        found = find_px4()
        if found is None or found.stand_in:
            pytest.skip("no PX4 is found: set PX4_HOME")
    return flown_sorties
