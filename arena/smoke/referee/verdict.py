"""The results of a scenario, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.language.model import Place, Vector

Outcome = Literal["passed", "failed", "not reached"]


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """A trigger, action or expectation, in simulation time.

    begun_s: time of its trigger, or from which its time counts [s].
    done_s: time at which it was carried out or fulfilled [s]; None: never.
    failure: a sentence with the observed values; "" if it did not fail.
    """

    place: Place
    outcome: Outcome
    kind: Literal["at", "do", "expect"] = "expect"
    begun_s: float | None = None
    done_s: float | None = None
    failure: str = ""

    @property
    def took_s(self) -> float | None:
        """The reaction time [s]."""
        return None if self.begun_s is None or self.done_s is None else self.done_s - self.begun_s


@dataclass(frozen=True, kw_only=True)
class RuleResult:
    """A rule of `always`, or one of the default rules.

    worst: the value nearest to breaking the rule, or farthest beyond, in `unit`; None if nothing was
        measured.
    at_s: time of that value [s].
    who: the vehicle, pair or process of that value.
    """

    place: Place
    outcome: Outcome
    worst: float | None = None
    unit: str = ""
    at_s: float | None = None
    who: str = ""
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class Touchdown:
    """The last touchdown of one vehicle.

    at_s: time [s].
    after_s: time since the last action [s], None without one.
    speed_m_s: speed at the last observation in the air [m/s].
    drift_m: horizontal distance from the position at the last action [m], None without one.
    """

    vehicle: str
    at_s: float
    after_s: float | None
    speed_m_s: float
    drift_m: float | None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The judgement of one flight.

    lasted_s: simulation time from the first to the last observation [s].
    ended: the reason why the flight ended.
    problems: failures of the flight itself.
    """

    steps: tuple[StepResult, ...]
    rules: tuple[RuleResult, ...]
    touchdowns: tuple[Touchdown, ...] = ()
    lasted_s: float = 0.0
    ended: str = ""
    problems: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[tuple[Place | None, str], ...]:
        """Each failure with its place in the scenario; the place is None for a failure of the flight itself."""
        judged: Sequence[StepResult | RuleResult] = (*self.steps, *self.rules)
        return (
            *((r.place, r.failure) for r in judged if r.outcome == "failed"),
            *((None, t) for t in self.problems),
        )

    @property
    def passed(self) -> bool:
        """True if nothing failed and every step passed."""
        return not self.failures and all(s.outcome == "passed" for s in self.steps)


@dataclass(frozen=True, kw_only=True)
class Row:
    """Values of one vehicle at one observation, for plots. nearest_m: distance to the nearest other vehicle
    [m].
    """

    time_s: float
    vehicle: str
    p_n: Vector
    height_m: float
    speed_m_s: float
    tilt_deg: float
    mode: str
    nearest_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Result:
    """A flight of one scenario. run: its run folder, "" if there is none. wall_s: duration [s], for
    information.
    """

    scenario: str
    file: str
    seed: int
    verdict: Verdict
    run: str = ""
    wall_s: float = 0.0
    pictures: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
