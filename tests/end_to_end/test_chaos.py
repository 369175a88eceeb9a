"""Flights of two real vehicles with random faults keep the rules of safety: twenty of the campaign of benchmarks/chaos.py."""

from __future__ import annotations

import pytest

from benchmarks.chaos import campaign

pytestmark = pytest.mark.crowd  # each flight has two worlds
FLIGHTS, JOBS = 20, 2


def test_random_faults_break_no_rule_of_safety(tmp_path):
    results = campaign(range(1, 1 + FLIGHTS), str(tmp_path), JOBS)
    wrong = [f"seed {r.script.seed}: {'; '.join(r.why)} | {r.script}" for r in results if r.why]
    assert not wrong, "\n".join(wrong)
    assert len(results) == FLIGHTS
    assert sum(r.took_off for r in results) >= FLIGHTS, (
        "too few vehicles took off for the rules to mean anything"
    )
