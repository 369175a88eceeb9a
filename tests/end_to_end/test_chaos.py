"""Flights of two real vehicles with random faults keep the rules of safety: twenty of the campaign of benchmarks/chaos.py."""

from __future__ import annotations

import pytest

from benchmarks.chaos import campaign

pytestmark = pytest.mark.crowd  # each flight has two worlds
FLIGHTS, JOBS = 20, 2


def test_random_faults_break_no_rule_of_safety(tmp_path):
    records = campaign(range(1, 1 + FLIGHTS), tmp_path, JOBS)
    wrong = [str(record) for record in records if record.why]
    assert not wrong, "\n".join(wrong)
    assert len(records) == FLIGHTS
    assert sum(r.airborne for r in records) >= FLIGHTS, (
        "too few vehicles took off for the rules to mean anything"
    )
