"""Tests of a process killed or stopped while vehicles fly: one per cell of the process table."""

from __future__ import annotations

import pytest

from .process_table import Hit, Sortie, Sorties, cells

pytestmark = pytest.mark.flight


@pytest.mark.parametrize(("sortie", "hit"), cells("air"))
def test_it_ends_as_the_table_says(sorties: Sorties, sortie: Sortie, hit: Hit) -> None:
    assert sorties.problems(sortie, hit) == []


@pytest.mark.px4
@pytest.mark.parametrize(("sortie", "hit"), cells("air", px4_only=True))
def test_it_ends_so_on_the_real_px4(sorties: Sorties, sortie: Sortie, hit: Hit) -> None:
    assert sorties.problems(sortie, hit, real=True) == []
