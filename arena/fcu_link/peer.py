"""Who, of all that send to a listening wire, is the vehicle. Pure."""

from __future__ import annotations

import math

from arena.fcu_link.settings import Address

SILENT_S = 3.0


class Partner:
    """The first address that the vehicle's autopilot speaks from; another one may follow when that has fallen silent."""

    def __init__(self) -> None:
        self.address: Address | None = None
        self._heard = -math.inf
        self.events: list[str] = []

    def accepts(self, sender: Address, speaks: bool, now: float) -> bool:
        """speaks: is there a frame of the vehicle's autopilot in what came?"""
        silent = now - self._heard
        if sender != self.address and speaks and silent > SILENT_S:
            was = (
                ""
                if self.address is None
                else f", and not from {_text(self.address)} any more, silent for {silent:.0f} s"
            )
            self.events.append(f"speaks from {_text(sender)}{was}")
            self.address = sender
        if sender != self.address:
            return False
        self._heard = now if speaks else self._heard
        return True


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}"
