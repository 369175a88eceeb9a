"""Decides whether an operator supervises the arena. If nobody does, the router stops its heartbeat.

Then the data-link failsafe of real vehicles can react. Pure, except `at_terminal`.

An operator is present if the supervisor runs in the foreground of a terminal that accepts output, or if somebody has used a
command such as `arena ps` within COMMAND_S. The router itself detects ground stations.
"""

from __future__ import annotations

import os

COMMAND_S = 60.0
BLOCKED_S = 5.0
"""A terminal that accepts no output for this time is frozen, or its ssh connection is stalled [s]."""


class OperatorPresence:
    """Decides whether an operator is present, at the terminal of `arena up` or by recent commands."""

    def __init__(self) -> None:
        self._command_at = float("-inf")

    def on_command(self, now: float) -> None:
        """Record that a person has sent a command to this arena.

        Commands are requests on the control socket.

        now: monotonic [s].
        """
        self._command_at = now

    def present(self, now: float, *, terminal: bool, blocked_s: float) -> bool:
        """Return whether an operator is at the terminal, or has sent a command in the last COMMAND_S seconds.

        terminal: the supervisor runs in the foreground of a terminal.
        blocked_s: time for which the terminal has accepted no output [s].
        """
        return (terminal and blocked_s < BLOCKED_S) or now - self._command_at <= COMMAND_S


def at_terminal() -> bool:
    """Return whether a person can press Ctrl-C: this process runs in the foreground of a terminal."""
    for fd in (0, 1):
        try:
            if os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp():
                return True
        except OSError:  # the terminal has been closed
            continue
    return False
