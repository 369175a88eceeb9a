"""Flights of two real vehicles with random faults keep the rules of safety: some of the campaign of benchmarks/chaos.py."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from benchmarks.chaos import campaign

from .chaos_seeds import DAILY, NIGHTLY

pytestmark = pytest.mark.crowd  # each flight has two worlds
JOBS = 2


@pytest.mark.parametrize(
    "seeds",
    [pytest.param(DAILY, id="daily"), pytest.param(NIGHTLY, id="nightly", marks=pytest.mark.nightly)],
)
def test_random_faults_break_no_rule_of_safety(seeds: Iterable[int], tmp_path: Path) -> None:
    flights = list(seeds)
    records = campaign(flights, tmp_path, JOBS)
    wrong = [str(record) for record in records if record.why]
    assert not wrong, "\n".join(wrong)
    assert len(records) == len(flights)
    assert sum(r.airborne for r in records) >= len(flights), (
        "too few vehicles took off for the rules to mean anything"
    )
