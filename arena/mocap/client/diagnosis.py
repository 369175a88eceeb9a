"""Why no pose comes from a motion-capture server: the sentences that fit every vendor. Pure."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from arena.mocap.client.reception import BodyStatus

RECOVERED = "motion capture: poses arrive again"
_MAX_NAMES = 8


def no_network(server: str, reason: str) -> str:
    """Return what to check when no socket towards the server can be opened."""
    return f"motion capture: no network route to {server} ({reason}): is this computer in its network? Retrying every second"


def no_pose(server: str, bodies: BodyStatus) -> str:
    """Return what to check when frames arrive without a wanted body; "" when all bodies are tracked."""
    if bodies.duplicate:
        return (
            f"motion capture: {server} has two bodies called {_list(bodies.duplicate)}, so the poses of both are dropped: "
            "rename one there"
        )
    if bodies.missing:
        there = f"it has {_list(sorted(bodies.names))}" if bodies.names else "it has no bodies"
        near = _nearest(bodies.missing[0], bodies)
        return (
            f"motion capture: {server} streams, but has no body {_list(bodies.missing)}; {there}."
            f"{f' Did you mean {near}?' if near else ''} Rename it there, or set the vehicle's mocap_body"
        )
    if bodies.hidden:
        return (
            f"motion capture: {server} streams, but does not track {_list(bodies.hidden)}: "
            "is it in view with all its markers, and enabled there?"
        )
    return ""


def _nearest(name: str, bodies: BodyStatus) -> str:
    """Return the server's name most similar to a missing one, ignoring case; "" without any."""
    by_lower = {name.lower(): name for name in sorted(bodies.names)}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return repr(by_lower[found[0]]) if found else ""


def _list(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:_MAX_NAMES])
    return shown + (f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else "")


class ChangeReport:
    """Passes on each diagnosis once, and reports once when the problem is over."""

    def __init__(self) -> None:
        self._reported = ""

    def changed(self, diagnosis: str) -> str | None:
        """Return the line to log now, None when nothing has changed."""
        if diagnosis == self._reported:
            return None
        self._reported = diagnosis
        return diagnosis or RECOVERED
