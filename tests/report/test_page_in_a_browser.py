"""report.html in a headless Chromium without network: a click on a number shows its moment in every figure.

The tests are skipped, and counted, if Chromium or playwright is missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from browser import SOFTWARE_GL, chromium
from recorded_flights import make_run

from arena.report.run_data import read_run
from arena.report.run_page import run_page

pytestmark = pytest.mark.browser
TIMEOUT_MS = 60_000


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield the page of a run of five vehicles, with all figures drawn. `page.requests` contains every URL that it requested."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    folder = tmp_path_factory.mktemp("browser")
    file = folder / "report.html"
    file.write_text(run_page(read_run(make_run(folder / "run", vehicles=5))))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(SOFTWARE_GL))
        opened = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True).new_page()
        opened.set_default_timeout(TIMEOUT_MS)
        opened.requests, opened.errors = [], []
        opened.on("request", lambda request: opened.requests.append(request.url))
        opened.on("pageerror", lambda error: opened.errors.append(str(error)))
        opened.goto(file.as_uri())
        opened.wait_for_selector("body.ready")
        opened.evaluate("window.report.drawAll()")
        yield opened
        browser.close()


def layouts(page: Any) -> dict[str, Any]:
    """Return figure -> its time range and its last vertical line."""
    return page.evaluate(
        """() => Object.fromEntries([...document.querySelectorAll('[data-time]')].map((e) =>
            [e.dataset.figure, {range: e._fullLayout.xaxis.range, line: (e.layout.shapes || []).at(-1)}]))"""
    )


def test_page_requests_nothing_but_itself(page):
    assert [url.partition(":")[0] for url in page.requests if not url.startswith(("data:", "blob:"))] == [
        "file"
    ]
    assert page.errors == []


def test_every_figure_is_drawn(page):
    drawn = page.evaluate(
        """() => [...document.querySelectorAll('[data-figure]')].map((e) =>
            [e.dataset.figure, e.querySelectorAll('svg, canvas').length])"""
    )
    assert len(drawn) >= 9 and all(count > 0 for _, count in drawn)
    assert set(page.evaluate("window.report.figures.position.data.map((t) => t.meta.vehicle || '')")) > {
        "uav1",
        "uav5",
    }


def test_clicked_number_shows_its_moment_in_every_figure(page):
    button = page.locator('[data-chart="tracking"][data-vehicle="uav2"]').first
    t = float(button.get_attribute("data-t"))
    before = layouts(page)
    button.click()
    page.wait_for_function(f"document.querySelector('[data-figure=height]').layout.shapes.at(-1)?.x0 === {t}")
    page.wait_for_function("!window.report.linking")
    after = layouts(page)
    assert len(after) >= 7
    for name, layout in after.items():
        low, high = layout["range"]
        assert low <= t <= high and high - low < before[name]["range"][1] - before[name]["range"][0], name
        assert layout["line"]["x0"] == layout["line"]["x1"] == t, name
    moment = page.evaluate("document.querySelector('[data-figure=map]').data.at(-1)")
    assert len(moment["x"]) == 1  # the click has selected uav2
    assert page.locator("#moment").inner_text() == f"{t:.2f} s"
    page.locator("#whole").click()
    page.wait_for_function("window.report.moment === null && !window.report.linking")
    assert layouts(page)["height"]["range"] == pytest.approx(before["height"]["range"])


def test_selected_vehicle_is_shown_in_the_details(page):
    page.evaluate("window.report.select(null)")
    page.locator('nav [data-vehicle-chip="uav3"]').click()
    shown = page.evaluate(
        """() => [...new Set(document.querySelector('[data-figure=position]').data
            .filter((t) => t.meta?.vehicle && t.visible).map((t) => t.meta.vehicle))]"""
    )
    assert shown == ["uav3"]
    assert page.locator("#position .showing").inner_text() == "uav3"
    page.evaluate("window.report.select(null)")


def test_zoom_in_one_figure_zooms_the_others(page):
    page.evaluate(
        "Plotly.relayout(document.querySelector('[data-figure=position]'), {'xaxis.range[0]': 7, 'xaxis.range[1]': 9})"
    )
    page.wait_for_function(
        "document.querySelector('[data-figure=timeline]')._fullLayout.xaxis.range[0] === 7 && !window.report.linking"
    )
    assert {tuple(layout["range"]) for layout in layouts(page).values()} == {(7, 9)}


def test_every_number_of_a_moment_shows_its_moment(page):
    """Click each button with a time. One click draws all figures, which is slow, so only the first one draws here."""
    page.evaluate("window.report.moment = null")
    slowest = page.get_by_role("button", name="0.998 at 7.2 s")
    slowest.evaluate("element => element.click()")
    page.wait_for_function(
        "document.querySelector('[data-figure=timeline]').layout.shapes.at(-1)?.x0 === 7.25"
    )
    found = page.evaluate(
        """() => {
            const wrong = [], buttons = [...document.querySelectorAll("button.jump")];
            window.report.updateTime = async () => {};
            for (const button of buttons) {
                const {t, chart} = button.dataset;
                window.report.moment = null;
                button.click();
                const figure = !chart || document.querySelector(`[data-figure="${chart}"]`);
                if (!figure || window.report.moment !== Number(t)) wrong.push([button.innerText, t, chart]);
            }
            delete window.report.updateTime;
            return {wrong, clicked: buttons.length};
        }"""
    )
    assert found["wrong"] == [] and found["clicked"] > 50, found
