"""Toolkit that flies several drones in a motion-capture arena, simulated or real, from one YAML file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arena.fly.connect import connect
    from arena.uav import UAV, Heart, Heartbeat

__all__ = ["UAV", "Heart", "Heartbeat", "connect"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import `arena.uav` and `arena.fly` only when one of their names is first used.

    Processes without a user program then do not load them.
    """
    if name == "connect":
        from arena.fly.connect import connect

        return connect
    if name in __all__:
        from arena import uav

        return getattr(uav, name)
    raise AttributeError(f"module 'arena' has no attribute {name!r}")
