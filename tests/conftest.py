"""What the whole suite shares."""

from __future__ import annotations

import pytest


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tests that need a real PX4 are counted, never skipped in silence."""
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if "px4" in getattr(r, "keywords", {})]
    ran = [r for r in terminalreporter.stats.get("passed", []) if "px4" in getattr(r, "keywords", {})]
    terminalreporter.write_line(f"real PX4: {len(ran)} tests ran, {len(skipped)} did not")
