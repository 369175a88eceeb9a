"""Detection of a pilot who takes manual control of a vehicle while land-all or kill-all commands it. Pure."""

from __future__ import annotations

from arena.wire.px4_mode import MANUAL_MODES

LEFT_S = 1.5
"""A manual mode counts as left after this time without a report of it [s]. A heartbeat is sent once a second, and
panic link and router do not deliver heartbeats in order."""
INPUT_S = 2.0
"""The pilot is present for this time after stick positions [s], if the vehicle has no radio according to the YAML."""


class PilotWatch:
    """Detects that a pilot has taken manual control of one vehicle since land-all or kill-all was started.

    The pilot has control when the armed vehicle reports a manual mode after it reported another mode, or after it
    reported that it was disarmed. A manual mode that the vehicle reports from the start does not count: this flight may be the
    reason why somebody started land-all.
    For such a vehicle, the link process and the router check themselves whether it may be commanded. A direct connection bypasses
    both, so it must not be used while `may_bypass` is false.
    radio: false if no pilot has a radio (`radio: none`): a manual mode then counts only with stick positions
    events: texts for the user; the caller takes them and empties the list
    mode: manual mode in which the pilot has control; "" if the pilot does not have control
    may_bypass: false from a report of a manual mode, or a refusal because the pilot has control, until another mode is reported
    """

    def __init__(self, *, radio: bool = True) -> None:
        self.mode = ""
        self.events: list[str] = []
        self.may_bypass = True
        self._other_reported = False
        self._left_at: float | None = None
        self._radio = radio
        self._input_at = float("-inf")

    @property
    def words(self) -> str:
        """Text for the user that a pilot has control, such as "pilot has control (POSCTL): not commanded"."""
        return f"pilot has control ({self.mode}): not commanded"

    def on_heartbeat(self, armed: bool, mode: str, now: float) -> None:
        """Process the arming state and flight mode from a heartbeat of the autopilot. now: monotonic [s]."""
        manual = armed and mode in MANUAL_MODES
        seen = self._radio or now - self._input_at <= INPUT_S
        self.may_bypass = not (manual and seen)
        if manual:
            self._left_at = None
            if self._other_reported and seen and not self.mode:
                self.mode = mode
                self.events.append(self.words)
            return
        self._other_reported = True
        if self.mode and self._left_at is None:
            self._left_at = now

    def on_stick_positions(self, now: float) -> None:
        """Record that the vehicle receives stick positions from a pilot's radio. now: monotonic [s]."""
        self._input_at = now

    def on_refusal(self) -> None:
        """Record that the router or the link process refused a command because a pilot has control."""
        self.may_bypass = False

    def has_control(self, now: float, mode: str | None) -> bool:
        """Return whether the pilot has manual control of the vehicle.

        A vehicle without telemetry stays under the pilot's control.
        now: monotonic [s]
        mode: mode that the vehicle reported last
        """
        if self._left_at is not None and now - self._left_at >= LEFT_S:
            self.mode, self._left_at = "", None
            self.events.append(f"pilot has left manual control ({mode}): commanded again")
        return bool(self.mode)
