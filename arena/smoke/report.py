"""Results for people and machines: a table, JUnit XML, results.json, pictures of what failed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import RenderableType

from arena.smoke.verdict import Result, Row


def table(results: Sequence[Result]) -> RenderableType:
    """For the terminal: a row a scenario, and under those that failed every reason with file:line."""
    raise NotImplementedError


def summary(results: Sequence[Result]) -> str:
    """One line: how many flew, failed, and in what wall time."""
    raise NotImplementedError


def junit_xml(results: Sequence[Result]) -> str:
    """JUnit XML as CI servers read it: one testcase a scenario."""
    raise NotImplementedError


def results_json(results: Sequence[Result]) -> str:
    """`read_results` reads it back equal."""
    raise NotImplementedError


def read_results(text: str) -> list[Result]:
    raise NotImplementedError


def draw(result: Result, rows: Sequence[Row], folder: Path) -> list[str]:
    """Height, distance and mode over time into folder/plots/scenario.png; returns the paths, for `Result.pictures`."""
    raise NotImplementedError
