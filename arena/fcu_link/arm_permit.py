"""Arm permit of a real vehicle: the permission of a person to arm this vehicle now. Pure.

The permit ends when the vehicle reboots, reconnects or is silent while it is disarmed, because then somebody may have
worked on it. An armed vehicle keeps it.
"""

from __future__ import annotations

from typing import Any


class ArmPermit:
    """Permission of a person to arm one vehicle.

    vehicle: name of the vehicle
    needed: false for a simulated vehicle or a flight controller in the loop, which need no permit
    by: who granted the permit; "" without a permit
    answer: result of the last request for a permit, for the person who sent it: `number` (differs for each request), `by`
        and `refusal` ("" if the permit was granted); empty before the first request
    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(self, vehicle: str, *, needed: bool) -> None:
        self._vehicle, self._needed = vehicle, needed
        self.by = ""
        self.answer: dict[str, Any] = {}
        self.events: list[str] = []
        self._armed = False
        self._interruption = ""  # happened while the vehicle was armed, as far as known

    @property
    def reasons(self) -> list[str]:
        """The missing arm permit as a reason not to arm the vehicle; empty if it has a permit or needs none."""
        if not self._needed or self.by:
            return []
        return [f"no arm permit: run arena arm-permit {self._vehicle}"]

    def grant(self, by: str, now: float, *, connected: bool, carried: bool = False) -> None:
        """Grant the permit to arm if the vehicle is connected and nobody carries it for its axes check.

        by: name of the person who grants the permit. connected: whether the vehicle is connected.
        carried: whether the identity and axes check is running. A permit would be valid at its end, beside the person.
        """
        if not self._needed:
            return
        refusal = ""
        if not connected:
            refusal = "the vehicle is not connected"
        elif carried:
            refusal = "the axes check is running"
        self.answer = {"number": int(now * 1e3), "by": by, "refusal": refusal}
        if refusal:
            self.events.append(f"no arm permit from {by}: {refusal}")
            return
        self.by = by
        self._interruption = ""
        self.events.append(f"arm permit granted by {by}")

    def on_heartbeat(self, armed: bool) -> None:
        """Store the arming state. After an interruption of the connection, withdraw the permit unless the vehicle is armed.

        armed: arming state, as reported in a heartbeat of the vehicle
        """
        self._armed = armed
        why, self._interruption = self._interruption, ""
        if why and not armed:
            self._withdraw(why)

    def on_interruption(self, why: str) -> None:
        """Withdraw the permit because of an interruption, such as a reboot.

        If the vehicle was armed, its next heartbeat decides: the permit stays if the vehicle is still armed.
        """
        if self._armed:
            self._interruption = why
        else:
            self._withdraw(why)

    def _withdraw(self, why: str) -> None:
        if self.by:
            self.events.append(
                f"arm permit of {self.by} withdrawn: {why}. To fly, run `arena arm-permit {self._vehicle}`"
            )
            self.by = ""
