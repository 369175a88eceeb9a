"""Questions to a vehicle over a wire that loses some: several in flight, asked again, and silence judged. Pure.

PX4 answers a name that it does not know with silence, and a lost packet sounds the same. A silence is believed once it would be
one chance in a million on this wire, by the share of packets it was seen to lose, and only of questions put in separate moments
during which the vehicle answered others. When no others are left, it is asked something that always has an answer: a probe.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

WINDOW = 10  # in flight at a time: some 400 bytes
_FEWEST, _MOST = 5, 30
_UNHEARD = 10  # questions that met silence when nothing else was answered either
_CHANCE = 1e-6
_FIRST_S, _SHORTEST_S, _LONGEST_S = 0.5, 0.2, 3.0
_BACK_OFF, _STEPS = 1.3, 2

Key = TypeVar("Key", bound=Hashable)
Fate = Literal["open", "answered", "silent", "lost"]


@dataclass(kw_only=True)
class Pace:
    """What has been learned of the wire: the time to an answer (by RFC 6298) and the share that gets none."""

    _mean_s: float = 0.0
    _spread_s: float = 0.0
    _patience_s: float = _FIRST_S
    _asked: int = 1
    _answered: int = 1

    def learn(self, tries: int, after_s: float) -> None:
        """An answer came to a question that was put `tries` times, the last one `after_s` ago [s]."""
        self._asked += tries
        self._answered += 1
        if tries > 1:  # to which of them is it the answer?
            return
        first = self._mean_s == 0.0
        self._spread_s = after_s / 2 if first else 0.75 * self._spread_s + 0.25 * abs(self._mean_s - after_s)
        self._mean_s = after_s if first else 0.875 * self._mean_s + 0.125 * after_s
        self._patience_s = min(max(self._mean_s + 4.0 * self._spread_s, _SHORTEST_S), _LONGEST_S)

    def patience(self, tries: int) -> float:
        """How long to wait for the answer to the `tries`-th of a question [s]."""
        return self._patience_s * _BACK_OFF ** min(tries - 1, _STEPS)

    @property
    def enough(self) -> int:
        """So many silences in a row are no accident."""
        loss = (self._asked - self._answered + 1) / (self._asked + 2)
        return min(max(math.ceil(math.log(_CHANCE) / math.log(loss)), _FEWEST), _MOST)


@dataclass(kw_only=True)
class _Question:
    """asked: the last time.  until: an answer is waited for.  heard: answers to others by then.  silences: that count."""

    tries: int = 0
    asked: float = 0.0
    until: float = -math.inf
    heard: int = 0
    silences: int = 0
    fate: Fate = "open"


class Asking(Generic[Key]):
    """A set of questions until each has its fate. probe: what always has an answer; it is not one of the questions."""

    def __init__(self, keys: Iterable[Key], pace: Pace, probe: Key) -> None:
        self._questions = {key: _Question() for key in keys}
        self._open = dict(self._questions)
        self._pace, self._probe = pace, probe
        self._heard = 0

    @property
    def over(self) -> bool:
        return not self._open

    def those(self, *fates: Fate) -> list[Key]:
        """The questions with one of these fates."""
        return [key for key, q in self._questions.items() if q.fate in fates]

    def due(self, now: float) -> list[Key]:
        """What to ask now; the probe among it where nothing else would show that the wire is alive."""
        self._judge(now)
        flying = sum(q.until > now for q in self._open.values())
        waiting = sorted(
            ((k, q) for k, q in self._open.items() if q.until <= now), key=lambda pair: pair[1].tries
        )
        chosen = waiting[: max(WINDOW - flying, 0)]
        doubtful = bool(chosen) and all(q.tries >= 1 for _, q in chosen)
        for _, q in chosen:
            q.tries += 1
            q.asked, q.until, q.heard = now, now + self._pace.patience(q.tries), self._heard
        return [key for key, _ in chosen] + ([self._probe] if doubtful else [])

    def answer(self, key: Key, now: float) -> None:
        """The answer to one of them, or the probe's, or what nobody asked here."""
        q = self._question(key)
        if q is not None:
            self._pace.learn(q.tries, now - q.asked)
            self._settle(key, q, "answered")

    def refuse(self, key: Key, fate: Fate) -> None:
        """The vehicle has said in words what becomes of it."""
        q = self._question(key)
        if q is not None:
            self._settle(key, q, fate)

    def _question(self, key: Key) -> _Question | None:
        q = self._open.get(key)
        if key == self._probe or (q is not None and q.tries):
            self._heard += 1
        return q if q is not None and q.tries else None

    def _judge(self, now: float) -> None:
        """Of those whose time is over: was it silence, or the wire?"""
        for key, q in list(self._open.items()):
            if q.tries and q.until <= now and q.until != -math.inf:
                q.until = -math.inf
                q.silences += self._heard > q.heard
                if q.silences >= self._pace.enough:
                    self._settle(key, q, "silent")
                elif q.tries - q.silences >= _UNHEARD:
                    self._settle(key, q, "lost")

    def _settle(self, key: Key, q: _Question, fate: Fate) -> None:
        q.fate = fate
        del self._open[key]
