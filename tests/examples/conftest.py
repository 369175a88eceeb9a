"""Examples fly as a user flies them, each on an address of its own."""

from __future__ import annotations

from end_to_end.conftest import hangar

__all__ = ["hangar"]
