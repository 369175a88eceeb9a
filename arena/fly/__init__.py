"""Flight of a vehicle of a running arena by a person: by hand, along a trajectory file, and from a notebook or a shell.

The vehicle is found by its name in the run folders. Nothing here is part of the arena: processes of the arena do not wait for it.
"""

from arena.fly.connect import Session, connect

__all__ = ["Session", "connect"]
