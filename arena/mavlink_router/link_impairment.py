"""The router's core behind links that are bad on purpose: datagrams between router and autopilots lost or delayed. Pure.

Loss is drawn per datagram, each way of each link by a generator of its own, so that one link's traffic does not change another's
fate. A delay keeps the order; when it shrinks, what has waited long enough for the new one goes on at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from arena.fault_injection import Fault, flag, number, word
from arena.mavlink_router.router import Out, Router
from arena.mavlink_router.routing_table import Address
from arena.wire.mavlink_frame import Buffer

LOST = "lost on purpose"
_LONGEST_MS = 60_000.0

# (since when it waits [s], the autopilot's address, the datagram)
Waiting = deque[tuple[float, Address, bytes]]


@dataclass(kw_only=True)
class _Way:
    """One direction of a link."""

    luck: Random
    waiting: Waiting = field(default_factory=deque)


@dataclass(kw_only=True)
class _Link:
    share: float = 0.0
    delay_s: float = 0.0
    up: _Way
    down: _Way

    @property
    def ways(self) -> tuple[_Way, _Way]:
        return self.up, self.down


class ImpairedRouter:
    """Stands before the router while something is wrong. at [s]: by the clock that delays are measured on, any that does not run
    back; now: monotonic [s], as the router's own. mute: the router's own heartbeat is not to be sent.
    """

    def __init__(self, router: Router, seed: int = 0) -> None:
        self._router = router
        self._links = {
            key: _Link(
                up=_Way(luck=Random(f"{seed} {name} up")), down=_Way(luck=Random(f"{seed} {name} down"))
            )
            for name, key in router.links.items()
        }
        self.mute = False

    def spoil(self, fault: Fault) -> str:
        """Do one of `arena.fault_injection` -> what it is, in a few words. Raises InputError for one that makes no sense."""
        kinds: dict[str, Callable[[Fault], str]] = {
            "loss": self._lose,
            "delay": self._delay,
            "heartbeat": self._beat,
        }
        return kinds[word(fault, "do", kinds)](fault)

    def calm(self) -> None:
        """All links are good again."""
        for link in self._links.values():
            link.share = link.delay_s = 0.0

    @property
    def bad(self) -> bool:
        """Something is wrong with a link, or waits in one."""
        return any(x.share or x.delay_s or x.up.waiting or x.down.waiting for x in self._links.values())

    @property
    def delaying(self) -> bool:
        return any(x.delay_s or x.up.waiting or x.down.waiting for x in self._links.values())

    @property
    def due(self) -> float | None:
        """When `release` has something to let go [s]."""
        return min(
            (way.waiting[0][0] + x.delay_s for x in self._links.values() for way in x.ways if way.waiting),
            default=None,
        )

    def on_datagram(self, socket: int, sender: Address, data: Buffer, now: float, at: float) -> list[Out]:
        """As the router's."""
        link = self._links.get(socket)
        if link is None or self._passes(link, link.down, sender, data, at):
            return self.outgoing(self._router.on_datagram(socket, sender, data, now), at)
        return []

    def outgoing(self, out: list[Out], at: float) -> list[Out]:
        """What of it leaves at once."""
        return [
            (data, left)
            for data, places in out
            if (left := tuple(p for p in places if self._leaves(*p, data, at)))
        ]

    def release(self, now: float, at: float) -> list[Out]:
        """What has waited long enough."""
        out: list[Out] = []
        for key, link in self._links.items():
            for _, sender, data in _ripe(link.down, at - link.delay_s):
                out += self.outgoing(self._router.on_datagram(key, sender, data, now), at)
            out += [(data, ((key, to),)) for _, to, data in _ripe(link.up, at - link.delay_s)]
        return out

    def _leaves(self, key: int, to: Address, data: Buffer, at: float) -> bool:
        link = self._links.get(key)
        return link is None or self._passes(link, link.up, to, data, at)

    def _passes(self, link: _Link, way: _Way, address: Address, data: Buffer, at: float) -> bool:
        """True: at once. Else it is lost, or waits."""
        if link.share and way.luck.random() < link.share:
            self._router.counts.dropped[LOST] += 1
        elif link.delay_s or way.waiting:
            way.waiting.append((at, address, bytes(data)))
        else:
            return True
        return False

    def _lose(self, fault: Fault) -> str:
        name, link = self._named(fault)
        link.share = number(fault, "share", 0.0, 1.0)
        return f"the link of {name} loses {100.0 * link.share:g} % each way"

    def _delay(self, fault: Fault) -> str:
        name, link = self._named(fault)
        ms = number(fault, "ms", 0.0, _LONGEST_MS)
        link.delay_s = 1e-3 * ms
        return f"the link of {name} is {ms:g} ms late each way" if ms else f"the link of {name} is in time"

    def _beat(self, fault: Fault) -> str:
        on = flag(fault, "on")
        self.mute = not on
        return f"the ground station's heartbeat {'goes on' if on else 'stops'}"

    def _named(self, fault: Fault) -> tuple[str, _Link]:
        name = word(fault, "vehicle", self._router.links)
        return name, self._links[self._router.links[name]]


def _ripe(way: _Way, until: float) -> list[tuple[float, Address, bytes]]:
    found = []
    while way.waiting and way.waiting[0][0] <= until + 1e-9:
        found.append(way.waiting.popleft())
    return found
