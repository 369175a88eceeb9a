"""Texts for the user about why a motion-capture server sends no poses, for all vendors. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from arena.mocap.client.reception import BodyStatus

RECOVERED = "motion capture: poses arrive again"
_MAX_NAMES = 8
_LATE_TIMES = 2


def no_network(server: str, reason: str) -> str:
    """Return the text for the user when the client cannot open a socket to the server."""
    return f"motion capture: no network route to {server} ({reason}): is this computer in the server's network? Retrying every second"


def no_pose(server: str, bodies: BodyStatus) -> str:
    """Return a message for the user if frames arrive without the pose of a requested body.

    Returns "" if all requested bodies are tracked.
    """
    if bodies.duplicate:
        return (
            f"motion capture: {server} has two bodies called {_list(bodies.duplicate)}, so the poses of both are dropped: "
            "rename one of them on the server"
        )
    if bodies.shared_ids:
        name, shared = next(iter(sorted(bodies.shared_ids.items())))
        return (
            f"motion capture: {server} has two bodies with the id {shared} ({name!r} is one of them), so the poses of both are "
            "dropped: give one of them another id on the server"
        )
    if bodies.missing:
        there = f"its bodies: {_list(sorted(bodies.names))}" if bodies.names else "it has no bodies"
        near = _nearest(bodies.missing[0], bodies)
        return (
            f"motion capture: {server} streams, but has no body {_list(bodies.missing)}; {there}."
            f"{f' Did you mean {near}?' if near else ''} "
            "Rename the body on the server, or set the vehicle's mocap_body to a name from this list"
        )
    if bodies.hidden:
        return (
            f"motion capture: {server} streams, but does not track {_list(bodies.hidden)}: "
            "is the body in view with all its markers, and enabled on the server?"
        )
    return ""


def _nearest(name: str, bodies: BodyStatus) -> str:
    """Return the name of a body on the server that is most similar to a missing name; "" if no name is similar.

    Upper and lower case count as equal.
    """
    import difflib  # rarely needed, and it would delay the start of each process that receives poses

    by_lower = {name.lower(): name for name in sorted(bodies.names)}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1)
    return repr(by_lower[found[0]]) if found else ""


def _list(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:_MAX_NAMES])
    return shown + (f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else "")


class LateFrames:
    """Detector of frames that arrive too late, with a text for the user.

    limit_s: lateness above which poses are dropped [s].
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._times = 0
        self._text = ""

    def diagnosis(self, late_s: float) -> str:
        """Return a message for the user if frames arrive late, else "". Call this method once a second.

        Frames arrive late if the newest frame was late at this call and at the call before it.
        late_s: lateness of the last frame [s]. The text keeps the first lateness, so that it is logged once.
        """
        self._times = self._times + 1 if math.isfinite(late_s) and late_s > self._limit_s else 0
        if self._times < _LATE_TIMES:
            self._text = ""
        elif not self._text:
            self._text = (
                f"motion capture: frames arrive {late_s:.2f} s late (limit {self._limit_s:g} s), so their poses are dropped: "
                "is the network or the server overloaded?"
            )
        return self._text


class ChangeReport:
    """Filter that returns each new diagnosis for the log once, and one line when the problem has ended."""

    def __init__(self) -> None:
        self._reported = ""

    def changed(self, diagnosis: str) -> str | None:
        """Return the line to log now, or None if the diagnosis is the same as at the last call."""
        if diagnosis == self._reported:
            return None
        self._reported = diagnosis
        return diagnosis or RECOVERED
