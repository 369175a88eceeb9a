"""The page of `arena monitor` in a real browser, beside a real arena."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from browser import chromium, open_page

from arena.supervisor import Control, open_run

from .flight import STANDS_M, Flight, Hangar, end_with_us, eventually, started_by

pytestmark = [pytest.mark.flight, pytest.mark.browser]
VEHICLES = {"uav1": "hovers", "uav2": "hovers"}
_CLICK = """name => {
    const button = [...document.querySelectorAll('button')].find(one => one.innerText.trim() === name);
    button?.click();
    return button !== undefined;
}"""


@contextlib.contextmanager
def monitor(hangar: Hangar) -> Iterator[str]:
    """Start `arena monitor` on a free port, and give the URL of its page."""
    with monitor_process(hangar) as (url, process):
        yield url
    assert process.returncode == 0


@contextlib.contextmanager
def monitor_process(hangar: Hangar) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start `arena monitor` on a free port, and give the URL of its page and the process."""
    with subprocess.Popen(
        [sys.executable, "-m", "arena.monitor", "--port", "0"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "ARENA_RUNTIME_DIR": str(hangar.runtime)},
        preexec_fn=end_with_us,  # noqa: PLW1509  nothing else is done in it
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[-1], process
        finally:
            process.terminate()
            process.wait(30)


def text_of(page: Any) -> str:
    return str(page.evaluate("document.body.innerText"))


def until_shown(page: Any, pattern: str, limit_s: float) -> re.Match[str]:
    found: re.Match[str] = eventually(
        lambda: re.search(pattern, text_of(page)), limit_s, pattern, lambda: text_of(page)
    )
    return found


def shown_height(page: Any, vehicle: str) -> float:
    """Return the height of a vehicle in the table of the page [m]."""
    return float(until_shown(page, rf"{vehicle}\s+\S+\s+(-?[\d.]+) m", 20)[1])


def press(page: Any, name: str) -> None:
    """Press a button.

    The page finds it and makes the click in one call. A page drawn in software beside other flights is slow to react to each call.
    """
    eventually(lambda: page.evaluate(_CLICK, name), 60, f"button {name}", lambda: text_of(page))


def plotted(page: Any, line: str) -> float | None:
    """Return the newest value of a line of the height plot, as its legend shows it under the mouse; None if there is none."""
    chart = page.locator(".uplot").nth(2)
    box = chart.locator(".u-over").bounding_box()
    page.mouse.move(box["x"] + box["width"] - 2, box["y"] + 0.5 * box["height"])
    found = re.search(rf"{line}:?\s*(-?[\d.]+)", str(chart.locator(".u-legend").inner_text()))
    return float(found[1]) if found else None


def until_plotted(page: Any, line: str, value: Callable[[], float]) -> None:
    """Wait until the height plot shows about this value [m] for one of its lines."""
    eventually(
        lambda: abs((plotted(page, line) or 1e9) - value()) < 0.1,
        20,
        f"{line}: {value()}",
        lambda: text_of(page),
    )


def picture(page: Any, name: str) -> None:
    """Save a picture of the page, if somebody wants to look at it: ARENA_PICTURES names the folder."""
    if folder := os.environ.get("ARENA_PICTURES"):
        page.screenshot(path=str(Path(folder) / f"{name}.png"), timeout=120_000)


def test_page_shows_the_flight_commands_it_and_survives_the_next_arena(hangar):
    chromium()
    with monitor(hangar) as url, open_page(url, width=1000, height=640) as page:
        until_shown(page, "no arena is running", 60)
        flight = hangar.fly(VEHICLES)
        flight.truth()  # the heights are counted from here
        until_shown(page, r"uav1\s+OFFBOARD", 60)
        flight.until_up(0.8)
        until_shown(page, r"uav2\s+OFFBOARD", 30)
        eventually(lambda: shown_height(page, "uav1") > 0.8, 20, "the height on the page")
        eventually(lambda: abs(flight.truth().v_n[0, 2]) < 0.05, 20, "hovers")

        def true_m() -> float:
            return -float(flight.truth().p_n[0, 2])

        eventually(
            lambda: abs(shown_height(page, "uav1") - true_m()) < 0.15, 20, "the true height on the page"
        )
        until_plotted(page, "actual", true_m)
        until_plotted(page, "setpoint", lambda: 1.05)
        picture(page, "flight")

        press(page, "LAND ALL")
        until_shown(page, r"uav1, uav2 where they are", 30)
        assert flight.heights().min() > 0.5, "the first step lands nothing"
        picture(page, "dialog")
        press(page, "Land uav1, uav2")
        for vehicle in VEHICLES:
            until_shown(page, rf"{vehicle}: landed and disarmed after", 60)
        picture(page, "landed")
        assert_down(flight, VEHICLES)

        flight.cli("down", "--now")
        flight.wait()
        until_shown(page, "no arena is running", 60)
        again = hangar.fly({"uav7": "hovers", "uav8": "hovers", "uav9": "hovers"})
        again.truth()
        again.until_up(0.8)
        until_shown(page, r"uav9\s+OFFBOARD", 60)
        assert "uav1" not in text_of(page).partition("Vehicles")[2]
        hold_land_and_kill(page, again)
        again.cli("down", "--now")


def hold_land_and_kill(page: Any, flight: Flight) -> None:
    """Hold uav7, start and cancel KILL ALL, land uav7, and stop the motors of all."""
    press(page, "HOLD uav7")
    until_shown(page, r"uav7: holds its position", 60)
    until_shown(page, r"uav7\s+AUTO.LOITER", 30)
    assert re.search(r"uav8\s+OFFBOARD", text_of(page)), "the other vehicle flies on"
    assert flight.heights().min() > 0.5

    press(page, "KILL ALL")
    until_shown(page, r"stops the motors of uav7, uav8, uav9 at once", 30)
    picture(page, "kill")
    focused = "document.activeElement.innerText.trim()"
    eventually(lambda: page.evaluate(focused) == "Cancel", 30, "Cancel has the focus")
    page.keyboard.press("Enter")
    eventually(lambda: "at once" not in text_of(page), 60, "the dialog is closed")
    assert flight.heights().min() > 0.5 and flight.fact("uav7.armed"), "Cancel stops nothing"

    press(page, "LAND uav7")
    until_shown(page, r"uav7: (landed and disarmed after|already on the ground)", 60)
    eventually(lambda: flight.heights()[0] < STANDS_M, 20, "uav7 on the floor")
    assert flight.heights()[1:].min() > 0.5 and flight.fact("uav8.mode") == "OFFBOARD", (
        "the other vehicle flies on"
    )

    press(page, "KILL ALL")
    press(page, "Stop the motors of uav7, uav8, uav9")
    for vehicle in ("uav8", "uav9"):
        until_shown(page, rf"{vehicle}: motors stopped", 60)
    picture(page, "killed")
    assert_down(flight, ("uav7", "uav8", "uav9"))


def assert_down(flight: Flight, vehicles: Iterable[str]) -> None:
    """Check by the arena itself that all vehicles are on the floor and disarmed."""
    flight.until_down(1)
    flight.until_disarmed(vehicles, 5)


def browser_processes() -> list[psutil.Process]:
    """Return the browser processes that this test has started."""
    return [p for p in psutil.Process().children(recursive=True) if "chrom" in p.name()]


def assert_hovers(flight: Flight, for_s: float) -> None:
    """Check that the simulation goes on, and that the vehicle keeps its place and mode. for_s: simulated time [s]."""
    begun = flight.truth()

    def is_over() -> bool:
        now = flight.truth()
        assert np.linalg.norm(now.p_n[0] - begun.p_n[0]) < 0.1
        return bool(now.time_s > begun.time_s + for_s)

    eventually(is_over, 10.0 * for_s, "the simulation goes on", flight.said)
    assert flight.fact("uav1.armed") and flight.fact("uav1.mode") == "OFFBOARD"


def test_hung_browser_and_killed_monitor_touch_no_vehicle(hangar):
    chromium()
    from playwright.sync_api import Error  # of a browser that has ended

    flight = hangar.fly({"uav1": "hovers"})
    flight.truth()  # the heights are counted from here
    flight.until_up(0.8)
    eventually(lambda: abs(flight.truth().v_n[0, 2]) < 0.05, 20, "hovers")
    with monitor_process(hangar) as (url, server):
        with contextlib.suppress(Error), open_page(url, width=1000, height=640) as page:
            until_shown(page, r"uav1\s+OFFBOARD", 60)
            hung = browser_processes()
            assert len(hung) > 2
            for process in hung:
                process.suspend()
            assert_hovers(flight, 6.0)
            for process in hung:
                process.kill()
        assert not psutil.wait_procs(hung, 10)[1]
        assert_hovers(flight, 1.0)
        with open_page(url, width=1000, height=640) as page:
            until_shown(page, r"uav1\s+OFFBOARD", 60)
            server.kill()
            assert_hovers(flight, 3.0)
    flight.cli("down")
    assert flight.wait() == 0


def test_time_bar_of_a_replay_is_moved_by_mouse_and_keyboard(hangar):
    chromium()
    flight = hangar.fly({"uav1": "tours"}, "--speed", "max", "--until-done", "--time-limit", "120")
    assert flight.wait(180) == 0, flight.said()
    runs = flight.runs.parent / "replays"
    options = ("--from", "2", "--pause", "--stay", "--headless", "--detach", "--runs", str(runs))
    started = flight.cli("replay", str(flight.folder), *options)
    assert started.returncode == 0, started.stdout + started.stderr
    (run,) = runs.glob("*")
    try:
        with monitor(hangar) as url, open_page(url, width=1000, height=640) as page:
            until_shown(page, r"uav1", 60)
            page.get_by_role("button", name="CONTINUE", exact=True).wait_for()
            drive_time_bar(page, run)
    finally:
        flight.cli("down", "--run", str(run))
        for pid in started_by(run):
            os.kill(pid, signal.SIGKILL)


def drive_time_bar(page: Any, run: Path) -> None:
    """Jump, step, continue and pause. The replay itself says where it is."""

    def stats() -> dict[str, Any]:
        state = open_run(run)
        assert state is not None
        found: dict[str, Any] = Control(Path(state.rt, "control.sock")).ask(do="view")
        return dict(found["processes"]["replay"]["stats"])

    def until_at(least_s: float, most_s: float) -> float:
        eventually(lambda: least_s <= stats()["time_s"] <= most_s, 30, f"{least_s} .. {most_s} s", stats)
        return float(stats()["time_s"])

    duration_s = float(stats()["duration_s"])
    thumb = page.get_by_role("slider").first
    box = thumb.locator("xpath=ancestor::*[contains(@class, 'Slider-track')][1]").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    middle_s = until_at(0.4 * duration_s, 0.6 * duration_s)
    assert stats()["paused"], "a jump does not end the pause"
    eventually(lambda: shown_height(page, "uav1") > 0.5, 30, "the height in the middle of the flight", stats)
    picture(page, "replay")

    thumb.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    until_at(middle_s + 0.05, middle_s + 2.0)
    page.keyboard.press("End")
    until_at(duration_s - 0.5, duration_s)
    page.keyboard.press("Home")
    until_at(0.0, 0.5)

    press(page, "CONTINUE")
    eventually(lambda: not stats()["paused"], 30, "the replay continues", stats)
    until_at(1.0, duration_s)
    press(page, "PAUSE")
    eventually(lambda: stats()["paused"], 30, "the replay is paused", stats)
    page.get_by_role("button", name="CONTINUE", exact=True).wait_for()
