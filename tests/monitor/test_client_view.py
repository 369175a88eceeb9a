"""Buttons of one browser: which run and which vehicles they command, and when."""

from __future__ import annotations

import asyncio
from pathlib import Path
from unittest.mock import MagicMock

import pytest

pytest.importorskip("viser")

from arena.monitor.client_view import ClientView


class Browser:
    """Browser with buttons that a test presses by their label."""

    def __init__(self):
        self.client, self.on_click = MagicMock(), {}
        self.client.gui.add_button.side_effect = self._button
        self.client.gui.add_dropdown.side_effect = lambda label, options, **_: MagicMock(value=options[0])

    def _button(self, label, **_):
        handle = MagicMock()
        handle.on_click.side_effect = lambda function: self.on_click.update({label: function})
        return handle

    def notes(self):
        return self.client.add_notification.call_count

    def press(self, label):
        asyncio.run(self.on_click[label](None))


class Runs:
    """The run that the page shows, and the commands that were given."""

    def __init__(self):
        self.run, self.given = Path("/runs/a"), []

    def give(self, action, run, vehicles):
        self.given.append((action, run, tuple(vehicles)))


@pytest.fixture
def page():
    browser, runs = Browser(), Runs()
    view = ClientView(browser.client, runs, vehicles=["uav1", "uav2"], run=lambda: runs.run)
    return browser, runs, view


@pytest.mark.parametrize(
    ("button", "yes", "action"),
    [
        ("KILL ALL", "Stop the motors of uav1, uav2", "kill"),
        ("LAND ALL", "Land uav1, uav2", "land"),
    ],
)
def test_command_to_all_needs_a_second_step(page, button, yes, action):
    browser, runs, _ = page
    browser.press(button)
    assert runs.given == []
    browser.press(yes)
    assert runs.given == [(action, Path("/runs/a"), ("uav1", "uav2"))]


def test_confirmation_commands_no_other_arena_than_the_shown_one(page):
    browser, runs, view = page
    browser.press("KILL ALL")
    runs.run = Path("/runs/b")
    view.change_arena(["uav1", "uav2"])
    browser.press("Stop the motors of uav1, uav2")
    assert runs.given == [] and browser.notes() == 1


def test_buttons_command_nothing_without_a_run(page):
    browser, runs, _ = page
    runs.run = None
    for button in ("KILL ALL", "LAND ALL", "HOLD uav1", "LAND uav1"):
        browser.press(button)
    assert runs.given == [] and "Cancel" not in browser.on_click
    assert browser.notes() == 4, "a button that does nothing says so"


def test_plots_name_their_vehicle():
    browser = Browser()
    heading = MagicMock()
    browser.client.gui.add_html.side_effect = lambda content, **_: (
        heading if "uav1" in content else MagicMock()
    )
    view = ClientView(browser.client, Runs(), vehicles=["uav1", "uav2"], run=lambda: None)
    assert browser.client.gui.add_html.call_args_list[0].args[0].endswith("<b>uav1</b></div>")
    view._vehicle.value = "uav2"
    view._on_vehicle()
    assert "<b>uav2</b>" in heading.content
