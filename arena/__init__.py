"""One YAML file becomes a flying arena."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arena.uav import UAV

__all__ = ["UAV"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """`from arena import UAV` without making every room that imports arena pay for it."""
    if name != "UAV":
        raise AttributeError(f"module 'arena' has no attribute {name!r}")
    from arena.uav import UAV

    return UAV
