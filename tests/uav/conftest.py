from __future__ import annotations

from collections.abc import Iterator

import pytest

from arena.uav import UAV, vehicle_control

from .fake import FakeAutopilot, free_address, until

CURVE = {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": 25.0}


def make_uav(address: tuple[str, int], **more: object) -> UAV:
    return UAV(
        "uav1", 1.52, 0.275, 0.1, 4, CURVE, link=f"udpin:{address[0]}:{address[1]}", system_id=1, **more
    )


@pytest.fixture(autouse=True)
def short_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fake autopilot asks for no stream before OFFBOARD."""
    monkeypatch.setattr(vehicle_control, "_STREAM_FIRST_S", 0.1)


@pytest.fixture
def autopilot() -> Iterator[FakeAutopilot]:
    with FakeAutopilot(free_address()) as fake:
        yield fake


@pytest.fixture
def uav(autopilot: FakeAutopilot) -> Iterator[UAV]:
    with make_uav(autopilot.to) as one:
        until(lambda: one.ekf.age_s < 0.5 and one.info.is_connected)
        yield one
