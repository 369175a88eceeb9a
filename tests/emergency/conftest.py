from __future__ import annotations

import pytest

from arena.emergency import dispatch
from arena.emergency.dispatch import TargetConnections
from arena.emergency.landing_sequence import LandingSequence


@pytest.fixture
def end_when(monkeypatch):
    """A function: end_when(condition) makes `bring_down` end once the condition holds, as after its timeout.

    A test that waits for the end of the time then needs no guess how long a slow machine takes.
    """
    is_over = TargetConnections.is_over

    def patch(condition):
        monkeypatch.setattr(
            TargetConnections, "is_over", lambda self, *args: condition() or is_over(self, *args)
        )

    return patch


@pytest.fixture
def confirmed(monkeypatch):
    """A function: confirmed(name) returns whether `bring_down` has confirmed the landing of this vehicle."""
    made = []
    monkeypatch.setattr(
        dispatch, "LandingSequence", lambda **given: made.append(LandingSequence(**given)) or made[-1]
    )
    return lambda name: any(landing.name == name and landing.confirmed for landing in made)
