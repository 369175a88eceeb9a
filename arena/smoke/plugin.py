"""Pytest plugin with the fixture `arena_run`, which flies scenarios or starts arenas for a test.

    def test_hover(arena_run):
        arena_run("hover.smoke.yaml")

    def test_a_killed_program(arena_run):
        with arena_run.up("two_quads.yaml") as flight:
            flight.until("uav1.airborne", 20)
            flight.do("kill program uav1")
            flight.expect("uav1.mode == LAND within 2 s")

Paths are relative to the file of the test. Every pytest run loads this module. Therefore it imports other modules of
arena only when a test uses the fixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from arena.smoke.flying.scripted_flight import ScriptedFlight
    from arena.smoke.referee.verdict import Result


class ArenaRun:
    """Object that a test gets from the fixture `arena_run`. It flies scenarios and starts arenas.

    folder: folder to which the paths of arenas and scenarios are relative.  results: folder for run folders.
    """

    def __init__(self, folder: Path, results: Path) -> None:
        self._folder, self.results = folder, results

    def __call__(
        self, scenario: str | Path, *, set: Sequence[str] = (), speed: str = "max", seed: int | None = None
    ) -> list[Result]:
        """Fly a scenario in every arena that its file names, and return the results.

        set: `key=value` texts that override the YAML, as `arena up --set`.
        speed: simulated seconds per second, or "max".  seed: of world and motion capture; None: as the YAML says.
        Raises AssertionError with the failures if the scenario fails, and InputError if the file is wrong.
        """
        from arena.smoke.flying.fly_scenario import FlightOptions, fly, refuse_real
        from arena.smoke.language.scenario import load_scenarios

        options, found = (
            FlightOptions(results=self.results, speed=speed, seed=seed),
            load_scenarios(self._folder / scenario, set),
        )
        for one in found:
            refuse_real(one.arena)
        results = [fly(one, options) for one in found]
        failed = [line for result in results for line in _complaints(result)]
        if failed:
            raise AssertionError("\n".join(failed))
        return results

    def up(
        self, arena: str | Path, *, set: Sequence[str] = (), speed: str = "max", seed: int | None = None
    ) -> ScriptedFlight:
        """Return a flight that the test controls: `with arena_run.up("arena.yaml") as flight: ...`.

        The arguments are the same as for a scenario. See `arena.smoke.flying.scripted_flight`.
        """
        from arena.schema import load_arena
        from arena.smoke.flying.fly_scenario import refuse_real
        from arena.smoke.flying.scripted_flight import ScriptedFlight
        from arena.smoke.flying.session import LaunchOptions

        file = self._folder / arena
        loaded = load_arena(file, list(set))
        refuse_real(loaded)
        return ScriptedFlight(
            loaded, LaunchOptions(arena=file, runs=self.results, overrides=tuple(set), speed=speed, seed=seed)
        )


def _complaints(result: Result) -> list[str]:
    if result.verdict.passed:
        return []
    where = [
        f"{place.file}:{place.line}: {text}" if place else text for place, text in result.verdict.failures
    ]
    return [f"{result.scenario}: run folder {result.run or 'none'}", *(f"  {line}" for line in where)]


@pytest.fixture
def arena_run(request: pytest.FixtureRequest, tmp_path: Path) -> ArenaRun:
    """Provide an object that flies scenarios or starts arenas for a test."""
    return ArenaRun(request.path.parent, tmp_path / "arena")
