"""A process of an arena is killed or stopped before anything is armed: who still flies. One test for each cell of the table."""

from __future__ import annotations

import pytest

from .process_table import SORTIES, Hit, Sortie, Sorties

pytestmark = pytest.mark.flight
CELLS = [(sortie, hit) for sortie in SORTIES if sortie.where == "ground" for hit in sortie.hits]


@pytest.mark.parametrize(("sortie", "hit"), CELLS, ids=[str(hit.cell) for _, hit in CELLS])
def test_on_the_ground_it_ends_as_the_table_says(sorties: Sorties, sortie: Sortie, hit: Hit) -> None:
    assert sorties.problems(sortie, hit) == []


@pytest.mark.px4
@pytest.mark.parametrize(
    ("sortie", "hit"), [c for c in CELLS if c[0].px4], ids=[str(h.cell) for s, h in CELLS if s.px4]
)
def test_on_the_ground_it_ends_so_on_the_real_px4(sorties: Sorties, sortie: Sortie, hit: Hit) -> None:
    assert sorties.problems(sortie, hit, real=True) == []
