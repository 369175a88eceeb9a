"""One vehicle's orders: given once with a reason, repeated until obeyed, made sterner where that does not help. Pure.

    nothing --broken--> ordered --its mode is seen--> obeyed --the program takes the vehicle, reason gone--> nothing
                           |                             '--the reason holds--> ordered anew
                           '--still broken after escalate_after_s: hold -> land -> terminate, up to at_most

An order is never taken back: only the vehicle on the ground, a pilot, or a program that takes it when the reason is gone ends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from arena.copilot.fleet_state import Broken
from arena.copilot.settings import STEPS, Rules, Step

MODES: dict[Step, str] = {"hold": "AUTO.LOITER", "land": "AUTO.LAND", "terminate": "disarmed"}
OPEN = frozenset(
    {"OFFBOARD", "AUTO.LOITER", "AUTO.TAKEOFF", "AUTO.MISSION", "AUTO.FOLLOW_TARGET", "AUTO.READY"}
)
"""Modes that the copilot may end: programs and SDKs fly in them. Every other is a pilot's, or a failsafe's answer already."""
REPEAT_S = 0.2
UNHEARD_S = 2.0
"""How long a hold is repeated to a vehicle that is not heard."""


@dataclass(frozen=True, kw_only=True)
class Present:
    """The vehicle's own last word. fresh: not too old to judge obedience by."""

    flying: bool
    mode: str
    fresh: bool


@dataclass(frozen=True, kw_only=True)
class Order:
    """Why, and since when [s]. obeyed_at: its mode was first seen; None before."""

    step: Step
    rule: str
    why: str
    given_at: float
    obeyed_at: float | None = None


@dataclass(frozen=True, kw_only=True)
class Acts:
    """send: the step to send now, None for nothing. said: sentences for the events."""

    send: Step | None = None
    said: tuple[str, ...] = ()


def may_end(mode: str, order: Order | None) -> bool:
    """May the copilot end this mode? Its own landing too, which has only termination above it."""
    return mode in OPEN or (order is not None and order.step != "hold" and mode == "AUTO.LAND")


@dataclass(kw_only=True)
class Escalation:
    """Ask `decide` once a step."""

    name: str
    rules: Rules
    order: Order | None = None
    _next_send: float = 0.0
    _left_alone: str = ""
    _said: list[str] = field(default_factory=list)
    _since: dict[str, float] = field(default_factory=dict)

    @property
    def held(self) -> bool:
        return self.order is not None and self.order.step == "hold"

    def decide(self, broken: Sequence[Broken], present: Present, now: float) -> Acts:
        """broken: rules that this vehicle breaks now."""
        self._said = []
        self._since = {b.rule: self._since.get(b.rule, now) for b in broken}
        if not present.flying:
            self._ground()
            return self._acts(None)
        if not may_end(present.mode, self.order):
            self._leave(broken, present.mode)
            return self._acts(None)
        self._left_alone = ""
        self._obey(broken, present, now)
        wanted = self._sternest(broken)
        if wanted is not None and (self.order is None or _rank(wanted[0]) > _rank(self.order.step)):
            self._give(*wanted, now)
        elif self.order is not None:
            self._escalate(self.order, broken, present, now)
        return self._acts(self._due(present, now))

    def _acts(self, send: Step | None) -> Acts:
        return Acts(send=send, said=tuple(self._said))

    def _ground(self) -> None:
        if self.order is not None:
            self._said.append(
                f"{self.name}: on the ground or disarmed; the order to {self.order.step} has ended"
            )
        self.order, self._left_alone = None, ""

    def _leave(self, broken: Sequence[Broken], mode: str) -> None:
        """Another hand has the vehicle."""
        if self.order is not None:
            self._said.append(
                f"{self.name}: in {mode} by another hand: left alone, the order to {self.order.step} has ended"
            )
            self.order = None
            self._left_alone = mode
        elif broken and self._left_alone != mode:
            self._said.append(f"{self.name}: {broken[0].rule}: {broken[0].why}; in {mode} it is left alone")
            self._left_alone = mode

    def _obey(self, broken: Sequence[Broken], present: Present, now: float) -> None:
        order = self.order
        if order is None or order.step == "terminate":
            return
        if present.mode == MODES[order.step]:
            if order.obeyed_at is None:
                self._said.append(f"{self.name}: {present.mode} after {now - order.given_at:.2f} s")
                self.order = _with(order, obeyed_at=now)
        elif order.obeyed_at is not None and not broken:
            self._said.append(f"{self.name}: in {present.mode} again, and the reason to {order.step} is gone")
            self.order = None
        elif order.obeyed_at is not None:
            self._said.append(
                f"{self.name}: in {present.mode} again, and the reason holds: {order.step} anew ({broken[0].why})"
            )
            # one that takes the vehicle again and again must not put off the next step
            fights = now - order.obeyed_at < self.rules.escalate_after_s
            self.order = _with(order, given_at=order.given_at if fights else now, obeyed_at=None)
            self._next_send = now

    def _sternest(self, broken: Sequence[Broken]) -> tuple[Step, Broken] | None:
        """The sternest step that any of these rules asks for, as far as `at_most` allows."""
        best: tuple[Step, Broken] | None = None
        for one in broken:
            do = self.rules.do[one.rule]
            if do == "none":
                continue
            step: Step = do if _rank(do) <= _rank(self.rules.at_most) else self.rules.at_most
            if best is None or _rank(step) > _rank(best[0]):
                best = step, one
        return best

    def _give(self, step: Step, cause: Broken, now: float) -> None:
        self.order = Order(step=step, rule=cause.rule, why=cause.why, given_at=now)
        self._next_send = now
        self._said.append(f"{self.name}: {step}: {cause.rule}: {cause.why}")

    def _escalate(self, order: Order, broken: Sequence[Broken], present: Present, now: float) -> None:
        """An answer that is not obeyed, or obeyed and no help. Silence is neither: what is not heard is not judged."""
        if not present.fresh or _rank(order.step) >= _rank(self.rules.at_most):
            return
        for one in broken:
            lasted = now - max(order.given_at, self._since[one.rule])
            helped = order.obeyed_at is not None and _rank(order.step) >= _rank(one.enough)
            if lasted >= self.rules.escalate_after_s and not helped:
                how = "it has not obeyed" if order.obeyed_at is None else "it is so still"
                why = f"{how} {now - order.given_at:.1f} s after the order to {order.step}: {one.why}"
                self._give(STEPS[_rank(order.step) + 1], Broken(row=one.row, rule=one.rule, why=why), now)
                return

    def _due(self, present: Present, now: float) -> Step | None:
        """To one that is not heard a hold is not repeated for ever: it may long be landing, by its failsafe or by land-all."""
        order = self.order
        if order is None or order.obeyed_at is not None or now < self._next_send:
            return None
        if (
            order.step == "hold"
            and not present.fresh
            and now - max(order.given_at, *self._since.values(), 0.0) > UNHEARD_S
        ):
            return None
        self._next_send = now + REPEAT_S
        return order.step


def _rank(step: Step) -> int:
    return STEPS.index(step)


def _with(order: Order, *, obeyed_at: float | None, given_at: float | None = None) -> Order:
    given = order.given_at if given_at is None else given_at
    return Order(step=order.step, rule=order.rule, why=order.why, given_at=given, obeyed_at=obeyed_at)
