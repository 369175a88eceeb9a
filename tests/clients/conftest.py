"""Fixtures for client tests: one arena per file, with the built-in autopilot and the real PX4 where it is found."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from end_to_end.flight import Flight, Hangar

from arena.schema.px4 import find_px4

from .site import Site

_SEEN: dict[str, int] = {}
FAST = (
    *("--speed", "3", "--processes"),
    # three times PX4's times, because a second of an SDK is three of the simulation
    *("--set", "failsafe.offboard_loss.after_s=3", "--set", "defaults.params.COM_DISARM_PRFLT=30"),
)
"""Options for the built-in autopilot. SDKs use real time; `max` would be too fast for their time limits."""


@pytest.fixture(scope="module", params=["builtin", pytest.param("px4", marks=pytest.mark.px4)])
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Give an arena: PX4 in real time, the built-in autopilot three times as fast."""
    kind = request.param
    if kind == "px4" and ((found := find_px4()) is None or found.stand_in):
        pytest.skip("no PX4 is found: set PX4_HOME")
    number = _SEEN[kind] = _SEEN.get(kind, 0) + 1
    address = f"127.82.{os.getpid() % 250 + 1}.{2 * number + (kind == 'px4')}"
    hangar = Hangar(tmp_path_factory.mktemp("clients"), address)
    try:
        yield _open(hangar, kind, getattr(request.module, "PX4_VEHICLE", "") if kind == "px4" else "")
    finally:
        hangar.close()


def _open(hangar: Hangar, kind: str, more: str) -> Site:
    """Start the arena. more: further keys of the vehicle in the YAML."""
    vehicle = 150 + os.getpid() % 40 if kind == "px4" else 1
    yaml = hangar.folder / "arena.yaml"
    yaml.write_text(
        f"name: clients\naddress: {hangar.address}\nworld: {{size: [200, 200, 60]}}\ndefaults: {{autopilot: {kind}}}\n"
        f"vehicles:\n  uav1: {{id: {vehicle}, start: {{position: [0, 0, 0]}}{more}}}\n"
    )
    flight: Flight = hangar.up(yaml, *(() if kind == "px4" else FAST))
    return Site(flight=flight, kind=kind, vehicle=vehicle)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many tests did not run because a client is not installed."""
    missing = [
        r for r in terminalreporter.stats.get("skipped", []) if "client is not installed" in str(r.longrepr)
    ]
    ran = [
        r
        for k in ("passed", "failed")
        for r in terminalreporter.stats.get(k, [])
        if "tests/clients/" in r.nodeid
    ]
    if missing or ran:
        terminalreporter.write_line(
            f"clients: {len(ran)} tests ran, {len(missing)} did not for a client that is not installed"
        )
