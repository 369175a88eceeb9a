"""State machine of the copilot's commands to one vehicle. Pure.

A command (class `Order`) is repeated until the vehicle reports the commanded mode. If the violation then
continues, the next step follows.

    none --violation--> ordered --its mode is reported--> obeyed --program in OFFBOARD again, no violation--> none
                           |                                '--violation persists--> ordered again
                           '--violation persists for escalate_after_s: hold -> land -> terminate, up to at_most

While a violation lasts, an obeyed hold is renewed, so that no program enters OFFBOARD. A landing needs no renewal: the
router and the links remember it until `arena release` (arena.authority).

The copilot never withdraws an order. An order ends when the vehicle is on the ground, when a pilot changes
the mode, or when the violation has ended and the program enters OFFBOARD again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from arena.authority import PROGRAM_MODES
from arena.copilot.fleet_state import Violation
from arena.copilot.settings import STEPS, Rules, Step

MODES: dict[Step, str] = {"hold": "AUTO.LOITER", "land": "AUTO.LAND", "terminate": "disarmed"}
OPEN = PROGRAM_MODES | {"AUTO.LOITER", "AUTO.READY"}
"""Modes that the copilot may end: those of programs and SDKs. All others belong to a pilot or a failsafe."""
REPEAT_S = 0.2
RENEW_S = 0.5
"""Period at which an obeyed hold is renewed while its violation lasts. It must be shorter than `COPILOT_HOLD_S`."""
SILENT_HOLD_S = 2.0
"""Time for which HOLD is repeated without telemetry [s]."""


@dataclass(frozen=True, kw_only=True)
class VehicleStatus:
    """Last reported state of a vehicle: whether it flies, its flight mode, and whether the report is recent.

    fresh: the report is recent enough to check whether the vehicle obeys an order.
    """

    flying: bool
    mode: str
    fresh: bool


@dataclass(frozen=True, kw_only=True)
class Order:
    """Command (hold, land or terminate) that the copilot gave to a vehicle and that still applies.

    given_at: time of the order [s]. obeyed_at: when the commanded mode was first reported [s]; None before.
    """

    step: Step
    rule: str
    why: str
    given_at: float
    obeyed_at: float | None = None


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Result of `Escalation.decide`: the command to send to one vehicle, and events to log.

    send: the order to send now, None if there is none. events: lines for the event log.
    renews: the vehicle obeys `send` already: it is sent only to the router, which refuses OFFBOARD for another second.
    """

    send: Step | None = None
    renews: bool = False
    events: tuple[str, ...] = ()


def may_end(mode: str, order: Order | None) -> bool:
    """Return whether the copilot may command a vehicle to leave its present flight mode.

    It may do so in the modes that user programs use (`OPEN`), and in a landing that the copilot itself has commanded. Only
    a termination, which is more severe, ends such a landing.
    """
    return mode in OPEN or (order is not None and order.step != "hold" and mode == "AUTO.LAND")


@dataclass(kw_only=True)
class Escalation:
    """State machine that decides which command the copilot sends to one vehicle: hold, land, terminate or none.

    Call `decide` once per step.
    """

    name: str
    rules: Rules
    order: Order | None = None
    _next_send: float = 0.0
    _left_alone: str = ""
    _events: list[str] = field(default_factory=list)
    _since: dict[str, float] = field(default_factory=dict)

    @property
    def held(self) -> bool:
        return self.order is not None and self.order.step == "hold"

    def decide(self, violations: Sequence[Violation], status: VehicleStatus, now: float) -> Decision:
        """Return the command that the vehicle must get now, and the events to log.

        violations: rules that this vehicle violates now.
        """
        self._events = []
        self._since = {b.rule: self._since.get(b.rule, now) for b in violations}
        if not status.flying:
            self._end_on_ground()
            return self._acts(None)
        if not may_end(status.mode, self.order):
            self._leave_to_others(violations, status.mode)
            return self._acts(None)
        self._left_alone = ""
        self._check_obedience(violations, status, now)
        wanted = self._most_severe(violations)
        if wanted is not None and (self.order is None or _rank(wanted[0]) > _rank(self.order.step)):
            self._start_order(*wanted, now)
        elif self.order is not None:
            self._escalate(self.order, violations, status, now)
        if self._renewal_is_due(violations, status, now):
            return Decision(send="hold", renews=True, events=tuple(self._events))
        return self._acts(self._due(status, now))

    def _acts(self, send: Step | None) -> Decision:
        return Decision(send=send, events=tuple(self._events))

    def _end_on_ground(self) -> None:
        if self.order is not None:
            self._events.append(
                f"{self.name}: on the ground or disarmed; the command {self.order.step} has ended"
            )
        self.order, self._left_alone = None, ""

    def _leave_to_others(self, violations: Sequence[Violation], mode: str) -> None:
        """Stop commanding the vehicle, because a pilot or a failsafe has changed its mode.

        If there is no order, a violation is reported once, but the vehicle is not commanded.
        """
        if self.order is not None:
            self._events.append(
                f"{self.name}: in {mode} by a pilot or a failsafe; the command {self.order.step} has ended"
            )
            self.order = None
            self._left_alone = mode
        elif violations and self._left_alone != mode:
            self._events.append(
                f"{self.name}: {violations[0].rule}: {violations[0].why}; not commanded in {mode} (pilot or failsafe)"
            )
            self._left_alone = mode

    def _check_obedience(self, violations: Sequence[Violation], status: VehicleStatus, now: float) -> None:
        order = self.order
        if order is None or order.step == "terminate":
            return
        if status.mode == MODES[order.step]:
            if order.obeyed_at is None:
                self._events.append(
                    f"{self.name}: in {status.mode} {now - order.given_at:.2f} s after the command"
                )
                self.order = _with(order, obeyed_at=now)
        elif order.obeyed_at is not None and not violations:
            self._events.append(
                f"{self.name}: in {status.mode} again, and the reason for {order.step} has ended"
            )
            self.order = None
        elif order.obeyed_at is not None:
            self._events.append(
                f"{self.name}: in {status.mode} again, but the violation continues: {order.step} again ({violations[0].why})"
            )
            # a program that takes the vehicle repeatedly must not delay the next step
            fights = now - order.obeyed_at < self.rules.escalate_after_s
            self.order = _with(order, given_at=order.given_at if fights else now, obeyed_at=None)
            self._next_send = now

    def _most_severe(self, violations: Sequence[Violation]) -> tuple[Step, Violation] | None:
        """Return the most severe command that the violations require, and its violation.

        The setting `at_most` limits the command. Returns None if no command is required.
        """
        best: tuple[Step, Violation] | None = None
        for one in violations:
            do = self.rules.do[one.rule]
            if do == "none":
                continue
            step: Step = do if _rank(do) <= _rank(self.rules.at_most) else self.rules.at_most
            if best is None or _rank(step) > _rank(best[0]):
                best = step, one
        return best

    def _start_order(self, step: Step, cause: Violation, now: float) -> None:
        self.order = Order(step=step, rule=cause.rule, why=cause.why, given_at=now)
        self._next_send = now
        self._events.append(f"{self.name}: {step}: {cause.rule}: {cause.why}")

    def _escalate(
        self, order: Order, violations: Sequence[Violation], status: VehicleStatus, now: float
    ) -> None:
        """Replace the command by a stronger one (land or terminate) if it is not obeyed or has no effect.

        An order has no effect if the vehicle obeys, the violation continues and the rule requires a stronger step.

        Without recent telemetry no next step is started.
        """
        if not status.fresh or _rank(order.step) >= _rank(self.rules.at_most):
            return
        for one in violations:
            lasted = now - max(order.given_at, self._since[one.rule])
            helped = order.obeyed_at is not None and _rank(order.step) >= _rank(one.enough)
            if lasted >= self.rules.escalate_after_s and not helped:
                how = "not obeyed" if order.obeyed_at is None else "no effect"
                why = f"{how} {now - order.given_at:.1f} s after the command {order.step}: {one.why}"
                self._start_order(
                    STEPS[_rank(order.step) + 1], Violation(row=one.row, rule=one.rule, why=why), now
                )
                return

    def _due(self, status: VehicleStatus, now: float) -> Step | None:
        """Return the command that the copilot must send to the vehicle now; None if there is nothing to send.

        Return None if the copilot has given no order, if the vehicle has obeyed the order, or if the command was sent less
        than REPEAT_S ago.

        Without telemetry HOLD is repeated for a short time only, because the vehicle may already be landing.
        """
        order = self.order
        if order is None or order.obeyed_at is not None or now < self._next_send:
            return None
        if (
            order.step == "hold"
            and not status.fresh
            and now - max(order.given_at, *self._since.values(), 0.0) > SILENT_HOLD_S
        ):
            return None
        self._next_send = now + REPEAT_S
        return order.step

    def _renewal_is_due(self, violations: Sequence[Violation], status: VehicleStatus, now: float) -> bool:
        """Return whether to repeat the hold command to a vehicle that already holds.

        This keeps programs from taking control while the violation lasts.
        """
        order = self.order
        if order is None or order.step != "hold" or order.obeyed_at is None or not status.fresh:
            return False
        if now < self._next_send or not any(self.rules.do[one.rule] != "none" for one in violations):
            return False
        self._next_send = now + RENEW_S
        return True


def _rank(step: Step) -> int:
    return STEPS.index(step)


def _with(order: Order, *, obeyed_at: float | None, given_at: float | None = None) -> Order:
    given = order.given_at if given_at is None else given_at
    return Order(step=order.step, rule=order.rule, why=order.why, given_at=given, obeyed_at=obeyed_at)
