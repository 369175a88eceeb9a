"""Router whose links to the autopilots can lose and delay datagrams, for fault injection. Pure.

Each direction of each link has its own random generator for losses, so that the traffic on one link does not
change the losses on another. A delay does not change the order of datagrams. If a delay is reduced, datagrams
that have already waited long enough are sent at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from arena.fault_injection import Fault, flag, number, word
from arena.mavlink_router.endpoints import Out
from arena.mavlink_router.router import Router
from arena.transport import Address
from arena.wire.mavlink_frame import Buffer

LOST = "lost by fault injection"
_MAX_DELAY_MS = 60_000.0

Waiting = deque[tuple[float, Address, bytes]]
"""(time of arrival [s], the autopilot's address, the datagram), oldest first."""


@dataclass(kw_only=True)
class _Direction:
    """State of one direction of a link: its random generator and its delayed datagrams."""

    random: Random
    waiting: Waiting = field(default_factory=deque)


@dataclass(kw_only=True)
class _ImpairedLink:
    """Loss and delay of datagrams on one link between the router and an autopilot.

    share: probability that a datagram is lost, 0 to 1 [-]. delay_s: delay of each datagram [s].
    up: state of the direction to the autopilot. down: state of the direction from the autopilot.
    """

    share: float = 0.0
    delay_s: float = 0.0
    up: _Direction
    down: _Direction

    @property
    def directions(self) -> tuple[_Direction, _Direction]:
        return self.up, self.down


class ImpairedRouter:
    """Router with active faults: it loses or delays datagrams on the links to autopilots.

    at, in every method: time for measuring delays [s], by any clock that never goes backwards
    now, in every method: monotonic [s], as in `Router`
    muted: the ground station's heartbeat must not be sent
    """

    def __init__(self, router: Router, seed: int = 0) -> None:
        self._router = router
        names = {key: name for name, key in router.links.items()}
        names |= {key: f"{name} ground" for name, key in router.ground_links.items()}
        self._links = {
            key: _ImpairedLink(
                up=_Direction(random=Random(f"{seed} {name} up")),
                down=_Direction(random=Random(f"{seed} {name} down")),
            )
            for key, name in names.items()
        }
        self._impaired: list[_ImpairedLink] = []  # links that have or had a fault: almost always none
        self.muted = False

    def apply(self, fault: Fault) -> str:
        """Apply one fault, such as loss on a link, and return a description of the fault as text.

        The fault is a JSON object, see `arena.fault_injection`.

        Raises InputError if the fault is invalid.
        """
        kinds: dict[str, Callable[[Fault], str]] = {
            "loss": self._apply_loss,
            "delay": self._apply_delay,
            "heartbeat": self._apply_heartbeat,
        }
        return kinds[word(fault, "do", kinds)](fault)

    def clear(self) -> None:
        """Set the loss and the delay of every link to zero."""
        for link in self._links.values():
            link.share = link.delay_s = 0.0

    @property
    def active(self) -> bool:
        """True while a link has a fault, or delayed datagrams still wait to be sent."""
        return bool(self._impaired) and any(
            link.share or link.delay_s or link.up.waiting or link.down.waiting for link in self._impaired
        )

    @property
    def delaying(self) -> bool:
        return any(link.delay_s or link.up.waiting or link.down.waiting for link in self._impaired)

    @property
    def due(self) -> float | None:
        """Time at which the next delayed datagram must be sent [s]; None if no datagram is delayed."""
        return min(
            (
                direction.waiting[0][0] + link.delay_s
                for link in self._impaired
                for direction in link.directions
                if direction.waiting
            ),
            default=None,
        )

    def on_datagram(self, socket: int, sender: Address, data: Buffer, now: float, at: float) -> list[Out]:
        """Route a received datagram with loss and delay. Return the datagrams to send now.

        The arguments `socket`, `sender` and `data` are those of `Router.on_datagram`.
        """
        link = self._links.get(socket)
        if link is None or self._passes(link, link.down, sender, data, at):
            return self.outgoing(self._router.on_datagram(socket, sender, data, now), at)
        return []

    def outgoing(self, out: list[Out], at: float) -> list[Out]:
        """Apply loss and delay to datagrams that the router is about to send. Return those to send now.

        out: (datagram, receivers) pairs, as returned by `Router.on_datagram`.
        """
        return [
            (data, left)
            for data, places in out
            if (left := tuple(p for p in places if self._leaves(*p, data, at)))
        ]

    def release(self, now: float, at: float) -> list[Out]:
        """Return the delayed datagrams whose delay has ended, to be sent now."""
        out: list[Out] = []
        for key, link in self._links.items():
            for _, sender, data in _take_until(link.down, at - link.delay_s):
                out += self.outgoing(self._router.on_datagram(key, sender, data, now), at)
            out += [(data, ((key, to),)) for _, to, data in _take_until(link.up, at - link.delay_s)]
        return out

    def _leaves(self, key: int, to: Address, data: Buffer, at: float) -> bool:
        link = self._links.get(key)
        return link is None or self._passes(link, link.up, to, data, at)

    def _passes(
        self, link: _ImpairedLink, direction: _Direction, address: Address, data: Buffer, at: float
    ) -> bool:
        """Return whether a datagram on a link must be sent now, without loss or delay.

        If not, the datagram is discarded or stored until its delay ends.
        """
        if link.share and direction.random.random() < link.share:
            self._router.counts.dropped[LOST] += 1
        elif link.delay_s or direction.waiting:
            direction.waiting.append((at, address, bytes(data)))
        else:
            return True
        return False

    def _apply_loss(self, fault: Fault) -> str:
        name, links = self._links_of(fault)
        share = number(fault, "share", 0.0, 1.0)
        for link in links:
            link.share = share
        return f"the link of {name} loses {100.0 * share:g} % in each direction"

    def _apply_delay(self, fault: Fault) -> str:
        name, links = self._links_of(fault)
        ms = number(fault, "ms", 0.0, _MAX_DELAY_MS)
        for link in links:
            link.delay_s = 1e-3 * ms
        return (
            f"the link of {name} is delayed by {ms:g} ms in each direction"
            if ms
            else f"the link of {name} is not delayed"
        )

    def _apply_heartbeat(self, fault: Fault) -> str:
        on = flag(fault, "on")
        self.muted = not on
        return f"the ground station's heartbeat {'is sent again' if on else 'is not sent'}"

    def _links_of(self, fault: Fault) -> tuple[str, list[_ImpairedLink]]:
        """Return the name of the vehicle that a fault concerns, and all router links of this vehicle.

        The links represent one radio, so that a fault applies to all of them.
        """
        router = self._router
        name = word(fault, "vehicle", router.links)
        links = [self._links[of[name]] for of in (router.links, router.ground_links) if name in of]
        self._impaired += [link for link in links if all(link is not known for known in self._impaired)]
        return name, links


def _take_until(direction: _Direction, until: float) -> list[tuple[float, Address, bytes]]:
    found = []
    while direction.waiting and direction.waiting[0][0] <= until + 1e-9:
        found.append(direction.waiting.popleft())
    return found
