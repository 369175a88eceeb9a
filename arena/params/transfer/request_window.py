"""Repetition of requests to a vehicle over a lossy link, several requests at a time. Pure.

PX4 does not answer a request for a parameter that it does not have. This looks like a lost packet. A request counts as
"ignored" after so many unanswered tries that packet loss alone would explain them in one case of a million; the loss of the
link is measured. Only tries during which the vehicle answered other requests count. If no other requests are open, a probe is
sent: a request that the vehicle always answers.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

WINDOW = 10  # requests in flight, about 400 bytes
_MIN_TRIES, _MAX_TRIES = 5, 30  # before a request counts as ignored
_LOST_TRIES = 10  # tries without an answer to any request, before a request counts as lost
_ACCIDENT_PROBABILITY = 1e-6
_FIRST_TIMEOUT_S, _MIN_TIMEOUT_S, _MAX_TIMEOUT_S = 0.5, 0.2, 3.0
_BACKOFF, _BACKOFF_STEPS = 1.3, 2

Key = TypeVar("Key", bound=Hashable)
RequestState = Literal["open", "answered", "ignored", "lost"]
"""open: not answered yet.  ignored: the vehicle answers other requests, but not this one.  lost: no request is answered."""


@dataclass(kw_only=True)
class LinkEstimate:
    """Measured quality of a link: round-trip time (as in RFC 6298) and share of unanswered requests."""

    _mean_s: float = 0.0
    _deviation_s: float = 0.0
    _timeout_s: float = _FIRST_TIMEOUT_S
    _requests: int = 1
    _answers: int = 1

    def add_answer(self, tries: int, delay_s: float) -> None:
        """Update the measured round-trip time and packet loss after an answer to a request.

        tries: number of times that the request was sent.
        delay_s: time since the request was last sent [s].
        """
        self._requests += tries
        self._answers += 1
        if tries > 1:  # the answer may belong to an earlier try
            return
        first = self._mean_s == 0.0
        deviation = abs(self._mean_s - delay_s)
        self._deviation_s = delay_s / 2 if first else 0.75 * self._deviation_s + 0.25 * deviation
        self._mean_s = delay_s if first else 0.875 * self._mean_s + 0.125 * delay_s
        self._timeout_s = min(max(self._mean_s + 4.0 * self._deviation_s, _MIN_TIMEOUT_S), _MAX_TIMEOUT_S)

    def timeout_s(self, tries: int) -> float:
        """Return how long to wait for an answer [s] after the last of `tries` requests."""
        return self._timeout_s * _BACKOFF ** min(tries - 1, _BACKOFF_STEPS)

    @property
    def tries_until_ignored(self) -> int:
        """Number of unanswered tries after which the vehicle seems to ignore a request.

        So many unanswered tries are too improbable to be explained by packet loss.
        """
        loss = (self._requests - self._answers + 1) / (self._requests + 2)
        tries = math.ceil(math.log(_ACCIDENT_PROBABILITY) / math.log(loss))
        return min(max(tries, _MIN_TRIES), _MAX_TRIES)


@dataclass(kw_only=True)
class _Request:
    """State of one request to a vehicle: number of tries, and time-out of the last try.

    tries: number of times that the request was sent.
    sent_at: time of the last try [s].
    deadline: time at which the wait for an answer ends [s].
    answers_before: number of answers to any request before the last try.
    unanswered: number of unanswered tries during which other requests were answered.
    """

    tries: int = 0
    sent_at: float = 0.0
    deadline: float = -math.inf
    answers_before: int = 0
    unanswered: int = 0
    state: RequestState = "open"


class RequestWindow(Generic[Key]):
    """Requests to one vehicle over a lossy link. Each is repeated until it is answered or has failed.

    keys: one key per request: a parameter name or an index.
    link: measured quality of the link; several windows can share it.
    probe: key of a request that the vehicle always answers; not one of `keys`.
    """

    def __init__(self, keys: Iterable[Key], link: LinkEstimate, probe: Key) -> None:
        self._requests = {key: _Request() for key in keys}
        self._open = dict(self._requests)
        self._link, self._probe = link, probe
        self._answers = 0

    @property
    def done(self) -> bool:
        """True if no request to the vehicle still waits for an answer."""
        return not self._open

    def with_state(self, *states: RequestState) -> list[Key]:
        """Return the keys of the requests that are in one of the given states."""
        return [key for key, request in self._requests.items() if request.state in states]

    def due(self, now: float) -> list[Key]:
        """Return the keys of the requests to send now, new or repeated.

        If all of them are repetitions, the probe is added. An answer to the probe shows that the link works.
        """
        self._close_overdue(now)
        in_flight = sum(request.deadline > now for request in self._open.values())
        waiting = sorted(
            ((key, request) for key, request in self._open.items() if request.deadline <= now),
            key=lambda pair: pair[1].tries,
        )
        chosen = waiting[: max(WINDOW - in_flight, 0)]
        needs_probe = bool(chosen) and all(request.tries >= 1 for _, request in chosen)
        for _, request in chosen:
            request.tries += 1
            request.sent_at, request.answers_before = now, self._answers
            request.deadline = now + self._link.timeout_s(request.tries)
        return [key for key, _ in chosen] + ([self._probe] if needs_probe else [])

    def answer(self, key: Key, now: float) -> None:
        """Record an answer to a request.

        Answers to requests that were not sent, or are closed, are ignored.

        key: key of the request, or of the probe (a request that the vehicle always answers)
        """
        request = self._count_answer(key)
        if request is not None:
            self._link.add_answer(request.tries, now - request.sent_at)
            self._close(key, request, "answered")

    def refuse(self, key: Key, state: RequestState) -> None:
        """Close a request that the vehicle has refused. state: new state of the request."""
        request = self._count_answer(key)
        if request is not None:
            self._close(key, request, state)

    def _count_answer(self, key: Key) -> _Request | None:
        """Count an answer, for the link quality. Return the request; None if the request was not sent or is closed.

        If the request was not sent or is closed, the answer is not counted. An answer to the probe is counted, but None is
        returned.
        """
        request = self._open.get(key)
        sent = request is not None and request.tries > 0
        self._answers += sent or key == self._probe
        return request if sent else None

    def _close_overdue(self, now: float) -> None:
        for key, request in list(self._open.items()):
            if request.tries and request.deadline <= now and request.deadline != -math.inf:
                request.deadline = -math.inf
                request.unanswered += self._answers > request.answers_before
                if request.unanswered >= self._link.tries_until_ignored:
                    self._close(key, request, "ignored")
                elif request.tries - request.unanswered >= _LOST_TRIES:
                    self._close(key, request, "lost")

    def _close(self, key: Key, request: _Request, state: RequestState) -> None:
        request.state = state
        del self._open[key]
