"""The pages of docs/reference are what the code says today."""

from __future__ import annotations

import pytest

from arena.cli.reference import FOLDER, pages

PAGES = (
    "yaml.md",
    "ports.md",
    "processes.md",
    "exit-codes.md",
    "cli.md",
    "scenarios.md",
    "log-columns.md",
    "placeholders.md",
    "ros2-topics.md",
    "channels.md",
    "mavlink-ids.md",
)


@pytest.mark.parametrize("name", PAGES)
def test_a_generated_page_is_up_to_date(name: str) -> None:
    assert (FOLDER / name).read_text() == pages()[name], "write them again: python -m arena.cli.reference"


def test_pages_do_not_depend_on_an_installed_px4(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PX4_HOME", "stand-in")
    assert (FOLDER / "processes.md").read_text() == pages()["processes.md"]


def test_every_page_is_compared() -> None:
    assert set(pages()) == set(PAGES)
