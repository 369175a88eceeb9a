from __future__ import annotations

import threading
import time
import types

import pytest

from arena.emergency import dispatch
from arena.emergency.landing_sequence import LandingSequence


@pytest.fixture
def end_when(monkeypatch):
    """A function: end_when(condition) makes the time of `bring_down` run out once the condition holds.

    A test that waits for the end of the time then needs no guess how long a slow machine takes.
    """

    def patch(condition):
        reached = threading.Event()

        def monotonic():
            if not reached.is_set() and condition():
                reached.set()
            return time.monotonic() + (1e6 if reached.is_set() else 0.0)

        monkeypatch.setattr(dispatch, "time", types.SimpleNamespace(monotonic=monotonic))

    return patch


@pytest.fixture
def confirmed(monkeypatch):
    """A function: confirmed(name) returns whether `bring_down` has confirmed the landing of this vehicle."""
    made = []
    monkeypatch.setattr(
        dispatch, "LandingSequence", lambda **given: made.append(LandingSequence(**given)) or made[-1]
    )
    return lambda name: any(landing.name == name and landing.confirmed for landing in made)
