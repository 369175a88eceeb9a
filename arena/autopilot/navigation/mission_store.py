"""The mission, geofence and rally points stored in one vehicle, and the progress of the mission.

No messages, no clock.
"""

from __future__ import annotations

from arena.autopilot.navigation.mission_items import FENCE, MISSION, RALLY, Item

CAPACITY = {MISSION: 10000, FENCE: 64, RALLY: 32}
"""Maximum number of items in each list, by MAV_MISSION_TYPE (PX4's limits)."""


class MissionStore:
    """Mission, fence and rally points of one vehicle: three lists of items, by MAV_MISSION_TYPE.

    items: the stored items
    ids: identifier of each list, a checksum of its items, 0 if empty
    current: index of the mission item that is flown now, or will be flown first
    reached: index of the last item reached, -1 if none
    valid: True if the mission is feasible; written by the feasibility check
    version: increases with each change of a list
    current_changes: increases when a client sets `current`
    progress_changes: increases when the flight reports progress
    """

    def __init__(self) -> None:
        self.items: dict[int, tuple[Item, ...]] = {MISSION: (), FENCE: (), RALLY: ()}
        self.ids: dict[int, int] = {MISSION: 0, FENCE: 0, RALLY: 0}
        self.current, self.reached = 0, -1
        self.valid = False
        self.version, self.current_changes, self.progress_changes = 0, 0, 0

    def replace(self, kind: int, items: tuple[Item, ...], list_id: int) -> None:
        """Replace the mission, the geofence or the rally points.

        kind: MAV_MISSION_TYPE
        list_id: identifier of the new list
        """
        self.items[kind], self.ids[kind] = items, list_id
        self.version += 1
        if kind == MISSION:
            marked = [k for k, item in enumerate(items) if item.current]
            self.reached = -1
            self.set_current(marked[-1] if marked else max(0, min(self.current, len(items) - 1)))

    def set_current(self, index: int) -> None:
        """Select the mission item to fly next, as requested by a client."""
        self.current = index
        self.current_changes += 1

    def set_progress(self, *, current: int | None = None, reached: int | None = None) -> None:
        """Store which mission item the vehicle flies to now, and which was reached.

        current: item to which the vehicle flies. reached: item that was reached. None keeps the old value
        """
        self.current = self.current if current is None else current
        self.reached = self.reached if reached is None else reached
        self.progress_changes += 1
