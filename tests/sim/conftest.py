"""Worlds that are closed after the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from arena.sim.world import World

from .sim_slices import slice_of


@pytest.fixture
def build() -> Iterator[Callable[..., World]]:
    """Return build(*vehicles, **changes of the slice), which makes worlds that are closed after the test."""
    made: list[World] = []

    def make(*vehicles: dict[str, Any], **changes: Any) -> World:
        made.append(World(slice_of(*vehicles, **changes)))
        return made[-1]

    yield make
    for world in made:
        world.close()
