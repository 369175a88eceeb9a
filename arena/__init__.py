"""One YAML file becomes a flying arena."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arena.uav import UAV, Heart

__all__ = ["UAV", "Heart"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """`from arena import UAV`, or `Heart`, without making every room that imports arena pay for it."""
    if name == "UAV":
        from arena.uav import UAV

        return UAV
    if name == "Heart":
        from arena.uav.heartbeat import Heart

        return Heart
    raise AttributeError(f"module 'arena' has no attribute {name!r}")
