"""Fixtures for tests of the examples."""

from __future__ import annotations

from end_to_end.conftest import hangar

__all__ = ["hangar"]
