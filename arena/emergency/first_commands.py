"""Sends the first landing or kill command to all vehicles, before most modules of land-all are loaded.

Loading the modules that check the landing takes tens of milliseconds, and much longer on a busy computer. This
module imports few modules, so that it starts fast. `dispatch` repeats the commands and reads the telemetry.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Sequence

from arena.emergency.landing_sequence import Action, LandingSequence
from arena.emergency.targets import Target
from arena.wire.mavlink_ids import EMERGENCY


def component_for(target: Target) -> int:
    """Return the MAVLink component id that `land-all` uses as the sender of its commands to a vehicle."""
    return EMERGENCY.component_at(signs=target.signs)


def send_first_commands(targets: Sequence[Target], action: Action) -> None:
    """Send the first landing or kill command to each vehicle, on its panic link and through its router.

    The panic link is a separate MAVLink connection of each vehicle that is reserved for emergencies. Errors are ignored,
    because `dispatch` repeats the commands.
    """
    sockets: dict[str, socket.socket] = {}
    now = time.monotonic()
    for target in targets:
        landing = LandingSequence(
            name=target.name, system=target.id, component=component_for(target), action=action, now=now
        )
        with contextlib.suppress(OSError):
            sender = sockets.get(target.partner[0]) or _open(sockets, target.partner[0])
            for frame in landing.due(now):
                for receiver in (target.autopilot, target.tools):
                    with contextlib.suppress(OSError):
                        sender.sendto(frame, receiver)
    for sender in sockets.values():
        sender.close()


def _open(sockets: dict[str, socket.socket], host: str) -> socket.socket:
    """Open a UDP socket that sends from the address `host` of this computer.

    The link process of a real vehicle drops datagrams from other addresses.
    """
    sender = sockets[host] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.setblocking(False)
    sender.bind((host, 0))
    return sender
