"""Registry of the cases: what a case is, and the decorator with which a module registers its cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from px4_contract.rig import Rig, Setup
from px4_contract.transcript import Transcript

Run = Callable[[Rig, Transcript], None]


@dataclass(frozen=True, kw_only=True)
class Case:
    """Case of the contract.

    ground: True if the case ends with a disarmed vehicle in HOLD on the floor, so that the next ground case
        can use it
    """

    name: str
    what: str
    run: Run
    setup: Setup = field(default_factory=Setup)
    ground: bool = True


CASES: dict[str, Case] = {}


def case(name: str, what: str, *, setup: Setup | None = None, ground: bool = True) -> Callable[[Run], Run]:
    """Return a decorator that registers a function as a case."""

    def register(run: Run) -> Run:
        assert name not in CASES, name
        CASES[name] = Case(name=name, what=what, run=run, setup=setup or Setup(), ground=ground)
        return run

    return register
