"""State of a running arena for viewers (programs that show an arena). Viewers send nothing to a vehicle.

A viewer calls `LiveFeed.poll` and gets a `Snapshot`. A viewer that hangs or dies changes nothing in the arena.
"""

from arena.live_view.feed import LiveFeed
from arena.live_view.fleet import FleetSnapshot
from arena.live_view.settings import Fence, Settings, VehicleSettings
from arena.live_view.snapshot import Event, Playback, ProcessRow, Snapshot

__all__ = [
    "Event",
    "Fence",
    "FleetSnapshot",
    "LiveFeed",
    "Playback",
    "ProcessRow",
    "Settings",
    "Snapshot",
    "VehicleSettings",
]
