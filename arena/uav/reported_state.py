"""State of a vehicle as its autopilot reports it, for commands that wait for a confirmation."""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from arena.uav.data_source import Source

TEXTS_S = 10.0
"""Age up to which warnings of the autopilot are quoted in errors [s]."""


class ReportedState:
    """Reads the newest telemetry of one vehicle: mode, arming, landed state, warnings."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def has(self, *, mode: str | None = None, armed: bool | None = None) -> bool:
        """Return whether the newest heartbeat reports a given mode and arming state. None skips a check."""
        heart = self._source.telemetry.heartbeat
        return heart is not None and mode in (None, heart.mode) and armed in (None, heart.armed)

    def has_entered(self, mode: str, since: float) -> bool:
        """Return whether a heartbeat that arrived after `since` [s] reports this flight mode."""
        heart = self._source.telemetry.heartbeat
        return heart is not None and heart.received_at > since and heart.mode == mode

    def is_ready(self) -> bool:
        """Return whether the vehicle can be armed: its estimate is new, and its pre-arm checks pass. An armed vehicle is ready."""
        t, limit = self._source.telemetry, self._source.limit_s
        if self._source.age(t.local) > limit("") or self._source.age(t.attitude) > limit(""):
            return False
        if t.heartbeat is None or self._source.age(t.heartbeat) > limit("heartbeat"):
            return False
        return t.heartbeat.armed or (t.status is not None and t.status.prearm)

    def is_disarmed_in_land(self) -> bool:
        """Return whether the vehicle is disarmed in AUTO.LAND. PX4's pre-arm checks fail in this mode."""
        return self.has(mode="AUTO.LAND", armed=False)

    def why_not_ready(self, waited_s: float, link: str, fault: str) -> str:
        """Return the reason why `is_ready` is False, as text.

        waited_s: time for which the program has waited [s].  link: URL of the connection.
        fault: error of the connection, "" without one.
        """
        t = self._source.telemetry
        if t.heartbeat is None:
            because = f" ({fault})" if fault else ""
            return f"no heartbeat from the autopilot has arrived at {link}{because}. Is the arena running?"
        for estimate, name in ((t.local, "position"), (t.attitude, "attitude")):
            if self._source.age(estimate) > self._source.stale_s:
                return f"the autopilot has no {name} estimate{self.texts()}"
        if self._source.age(t.heartbeat) > self._source.limit_s("heartbeat"):
            return (
                f"the autopilot's last heartbeat is {self._source.age(t.heartbeat):.1f} s old{self.texts()}"
            )
        return f"the autopilot's pre-arm checks fail{self.texts(waited_s + TEXTS_S)}"

    def is_down(self) -> bool:
        """Return whether the vehicle is disarmed and on the ground. A landed state that is too old does not count."""
        ground = self._source.telemetry.ground
        fresh = self._source.age(ground) <= self._source.limit_s("landed state")
        return fresh and ground is not None and ground.landed and self.has(armed=False)

    def has_left_landing(self) -> bool:
        """Return whether the vehicle has stopped landing: it is armed, and its mode is not AUTO.LAND."""
        return self.has(armed=True) and not self.has(mode="AUTO.LAND")

    def words(self) -> str:
        """Return mode, arming, landed state and newest warnings of the vehicle, as text for errors."""
        t = self._source.telemetry
        if t.heartbeat is None:
            return "no heartbeat has arrived"
        ground = "unknown" if t.ground is None else "on the ground" if t.ground.landed else "in the air"
        age = self._source.age(t.heartbeat)
        return f"mode {t.heartbeat.mode}, {'armed' if t.heartbeat.armed else 'disarmed'}, {ground}, {age:.1f} s ago{self.texts()}"

    def texts(self, seconds: float = TEXTS_S) -> str:
        """Return the last three warnings of the autopilot as the end of an error message; "" without a warning.

        seconds: age up to which a warning counts [s].
        """
        worst = mavlink.MAV_SEVERITY_WARNING
        texts = self._source.telemetry.recent_texts(self._source.now() - seconds, worst)
        return f"; autopilot: {'; '.join(texts[-3:])}" if texts else ""
