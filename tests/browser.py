"""A real browser for tests of pages: Debian's chromium without a screen, driven by playwright."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SOFTWARE_GL = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

PICTURE_PERIOD_MS = 1000
"""Time between two pictures of a page. At its own rate, drawing in software takes all that the arena leaves of the cores."""
SCALE = 1.0 if "ARENA_PICTURES" in os.environ else 0.25
"""Pixels drawn per pixel of the page, in each direction. Pictures for people have all pixels."""
_DRAW_RARELY = f"""
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), {PICTURE_PERIOD_MS});
window.cancelAnimationFrame = clearTimeout.bind(window);
"""


def chromium() -> str:
    """Return the path of chromium; skip the test if there is none."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no chromium is found: apt-get install chromium")
    pytest.importorskip("playwright")
    return found


@contextlib.contextmanager
def open_page(url: str, *, width: int = 1440, height: int = 900) -> Iterator[Any]:
    """Open a URL in a new browser, and give its playwright page."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        patient = Path(folder) / "chromium"  # a page drawn in software must not slow the arena down
        patient.write_text(f'#!/bin/sh\nexec nice -n 15 {path} "$@"\n')
        patient.chmod(0o700)
        browser = playwright.chromium.launch(executable_path=str(patient), args=list(SOFTWARE_GL))
        page = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=SCALE)
        page.add_init_script(_DRAW_RARELY)
        page.set_default_timeout(120_000)  # beside other flights the page has little of the cores
        page.goto(url)
        yield page
        browser.close()
