"""How late a captured frame arrives, by the server's own time stamp against the receiver's clock. Pure.

The two clocks share no zero: only differences mean anything, so lateness counts from the promptest frame heard. A stamp may
also be wrong. One that lies in the future must not become the measure of the frames after it, which would all look late and
leave the vehicle blind; one that lies far in the past must not either, or a queue that is emptied after a stall would pass
for news.
"""

from __future__ import annotations

from math import inf, isfinite

_RUN = 9  # stamps in a row that lie in the future: the server's clock has been set forward
_SETTLED_S = 3.0  # all late for so long, nobody flying: the server's clock has been set back
_DRIFT = 1e-3  # how far the two clocks may part, seconds a second; a crystal's error is a tenth of it


class Lateness:
    """stale_s: the lateness that is too much [s]. shifts: how often the server's clock was found to have been set."""

    def __init__(self, stale_s: float) -> None:
        self._stale_s = stale_s
        self.shifts = 0
        self.forget()

    def forget(self) -> None:
        """The next frame is the first of another clock."""
        self._prompt: float | None = None
        self._now = -inf
        self._early = 0
        self._late_since: float | None = None

    def of(self, stamp_s: float, now: float, flying: bool) -> float:
        """Seconds late, infinite for a stamp that cannot be believed. stamp_s, now: [s]. flying: no clock is believed to have
        been set back, for that is also what a queue looks like that stays full.
        """
        offset = now - stamp_s
        if not isfinite(offset):
            return inf
        if self._prompt is None:
            self._prompt, self._now = offset, now
            return 0.0
        self._prompt += _DRIFT * min(max(now - self._now, 0.0), 0.1)
        self._now = now
        late = offset - self._prompt
        self._early = self._early + 1 if late < -self._stale_s else 0
        if self._early:
            return self._shift(offset) if self._early >= _RUN else inf
        return self._settle(offset, late, now, flying)

    def _settle(self, offset: float, late: float, now: float, flying: bool) -> float:
        if late <= self._stale_s:
            self._late_since = None
            self._prompt = offset - max(late, 0.0)
            return max(late, 0.0)
        self._late_since = now if self._late_since is None or flying else self._late_since
        return self._shift(offset) if now - self._late_since >= _SETTLED_S else late

    def _shift(self, offset: float) -> float:
        self.shifts += 1
        self._prompt, self._early, self._late_since = offset, 0, None
        return 0.0
