"""The referee: looks at a flight fifty times a second of its own time, says what is to be done when, and judges. Pure.

    referee = Referee(scenario)
    while not referee.over:
        for deed in referee.look(now):      # those due at this instant, `undo` ones among them
            try: carry it out
            except ArenaError as error: referee.refused(deed, str(error))
    referee.finish(outcome)                 # when the arena has ended, whatever ended it
    result = referee.verdict()

The same looks give the same verdict: nothing here knows of wall time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from arena.smoke.scenario import Scenario
from arena.smoke.verdict import Row, Verdict
from arena.smoke.words import Deed, Now


class Referee:
    """Of one flight."""

    def __init__(self, scenario: Scenario) -> None:
        raise NotImplementedError

    def look(self, now: Now) -> list[Deed]:
        """The deeds due at this instant, in order; a look must not be earlier than the one before."""
        raise NotImplementedError

    def refused(self, deed: Deed, why: str) -> None:
        """This deed of the last look could not be carried out: its step has failed."""
        raise NotImplementedError

    @property
    def over(self) -> bool:
        """Nothing more is to be seen: all steps done and all vehicles down, or one failed, or the time limit has come."""
        raise NotImplementedError

    @property
    def why_over(self) -> str:
        raise NotImplementedError

    def finish(self, outcome: Mapping[str, Any], trouble: str = "") -> None:
        """The arena has ended. outcome: its outcome.json, {} where there is none. trouble: what else went wrong, in words, such
        as an arena that did not come up, or a world that no longer moved: it fails the scenario.
        """
        raise NotImplementedError

    def verdict(self) -> Verdict:
        """After `finish`."""
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[Row]:
        """For pictures: every vehicle at ten looks a second of simulation time."""
        raise NotImplementedError
