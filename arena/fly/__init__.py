"""Flight of a vehicle by a person: by hand, along a trajectory file, or from a notebook or a shell.

The vehicle belongs to a running arena.

The vehicle is found by its name in the run folders. Nothing here is part of the arena: processes of the arena do not wait for it.
"""

from arena.fly.connect import Session, connect

__all__ = ["Session", "connect"]
