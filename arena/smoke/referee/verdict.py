"""What came of a scenario, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from arena.smoke.language.model import Place, Vector

Outcome = Literal["passed", "failed", "not reached"]


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """One moment, deed or expectation, in simulation time. begun_s: when its moment came, or it counts from [s]; done_s: when
    it was carried out or fulfilled [s]; None: never. failure: why it failed, a sentence with what was seen; "" otherwise.
    """

    place: Place
    outcome: Outcome
    kind: Literal["at", "do", "expect"] = "expect"
    begun_s: float | None = None
    done_s: float | None = None
    failure: str = ""

    @property
    def took_s(self) -> float | None:
        """Its reaction time [s]."""
        return None if self.begun_s is None or self.done_s is None else self.done_s - self.begun_s


@dataclass(frozen=True, kw_only=True)
class RuleResult:
    """One rule of `always`, or one that holds by default. worst: the value nearest to breaking it, or farthest beyond, in the
    unit of the rule; at_s: when [s]; who: between or of whom; None and "" where nothing was measured.
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
    """How one vehicle came down for the last time. at_s: [s]; after_s: since the last deed [s], None without one;
    speed_m_s: of the last look in the air [m/s]; drift_m: sideways from where it was at the last deed [m], else None.
    """

    vehicle: str
    at_s: float
    after_s: float | None
    speed_m_s: float
    drift_m: float | None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """troubles: what went wrong with the flight itself. lasted_s: simulation time from the first look to the last [s].
    ended: why there were no more looks.
    """

    steps: tuple[StepResult, ...]
    rules: tuple[RuleResult, ...]
    touchdowns: tuple[Touchdown, ...] = ()
    lasted_s: float = 0.0
    ended: str = ""
    troubles: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[tuple[Place | None, str], ...]:
        """Where it was asked for (None: nowhere, the flight itself went wrong), and the sentence."""
        judged: Sequence[StepResult | RuleResult] = (*self.steps, *self.rules)
        return (
            *((r.place, r.failure) for r in judged if r.outcome == "failed"),
            *((None, t) for t in self.troubles),
        )

    @property
    def passed(self) -> bool:
        return not self.failures and all(s.outcome == "passed" for s in self.steps)


@dataclass(frozen=True, kw_only=True)
class Row:
    """What the referee kept of one look at one vehicle, for pictures. nearest_m: distance to the nearest other vehicle [m]."""

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
    """One flight of one scenario. run: its run folder, "" where none came to be; wall_s: [s], for information alone."""

    scenario: str
    file: str
    seed: int
    verdict: Verdict
    run: str = ""
    wall_s: float = 0.0
    pictures: tuple[str, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
