"""A vehicle with a pilot arms only with an RC signal and a kill switch that was tried. Review fault 1."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.preflight_checks import TEXT_BYTES, sentence
from arena.fcu_link.radio_check import RadioCheck
from arena.fcu_link.stream_requests import StreamRequests
from arena.wire.px4_mode import mode_numbers

from .link_rig import ID, Rig, arm, heartbeat, rc_channels, sys_status

GOOD = {"RC_MAP_KILL_SW": 7.0, "COM_RC_IN_MODE": 0.0}
NO_SIGNAL = "no RC signal: is the transmitter on?"
TEST = "test the kill switch: on for 2 s, then off"


class Radio:
    """A RadioCheck with a clock, and an autopilot that reports a transmitter."""

    def __init__(self) -> None:
        self.check, self.now, self.params = RadioCheck([0, 3]), 100.0, dict(GOOD)

    def wait(
        self,
        seconds: float = 1.0,
        *,
        rc: bool = True,
        kill: bool = False,
        armed: bool = False,
        channels: bool | None = None,
        mode: int = 0,
    ) -> Radio:
        for _ in range(round(2 * seconds)):
            self.now += 0.5
            messages = [sys_status(rc=rc, rc_healthy=not kill), heartbeat(armed, kill, mode)]
            messages = [rc_channels(), *messages] if (rc if channels is None else channels) else messages
            for m in messages:
                self.check.on_autopilot(m, self.now)
        return self

    def reasons(self) -> list[str]:
        return self.check.reasons(self.now, self.params)


def test_a_tried_kill_switch_allows_arming() -> None:
    radio = Radio().wait()
    assert radio.reasons() == [TEST]
    assert radio.wait(kill=True).reasons() == ["kill switch is on"]
    assert radio.wait().reasons() == []


def test_fault_1_without_a_transmitter_there_is_a_reason() -> None:
    assert Radio().reasons() == [NO_SIGNAL]
    assert Radio().wait(5, rc=False).reasons() == [NO_SIGNAL]


def test_a_signal_that_stops_is_a_reason_again() -> None:
    radio = Radio().wait().wait(kill=True).wait()
    assert radio.wait(1, rc=False).reasons() == [NO_SIGNAL]
    assert radio.wait(1).reasons() == []
    radio.now += 3.5
    assert radio.reasons() == [NO_SIGNAL]


def test_a_joystick_is_no_transmitter() -> None:
    """With COM_RC_IN_MODE 3 or 5 SYS_STATUS counts a joystick; RC_CHANNELS comes from the RC receiver only."""
    radio = Radio().wait(channels=False).wait(kill=True, channels=False).wait(channels=False)
    assert radio.reasons() == [NO_SIGNAL]
    radio.check.on_autopilot(rc_channels(count=0), radio.now)
    assert radio.reasons() == [NO_SIGNAL]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"RC_MAP_KILL_SW": 0.0}, "no kill switch: set RC_MAP_KILL_SW"),
        ({"RC_MAP_KILL_SW": math.nan}, "no kill switch: set RC_MAP_KILL_SW"),
        ({"COM_RC_IN_MODE": 4.0}, "COM_RC_IN_MODE 4 can ignore the RC switches"),
        ({"COM_RC_IN_MODE": 1.0}, "COM_RC_IN_MODE 1 can ignore the RC switches"),
        ({"COM_RC_IN_MODE": 2.0}, "COM_RC_IN_MODE 2 can ignore the RC switches"),
        ({"COM_RC_IN_MODE": None}, "RC setup not read yet"),
        ({"COM_RC_IN_MODE": 3.0}, ""),
    ],
)
def test_fault_1_parameters_of_the_transmitter(change: dict[str, float | None], reason: str) -> None:
    radio = Radio().wait().wait(kill=True).wait()
    radio.params |= change  # type: ignore[arg-type]
    assert radio.reasons() == ([reason] if reason else [])


def test_a_kill_in_flight_is_no_test() -> None:
    radio = Radio().wait(armed=True).wait(kill=True, armed=True).wait(armed=True).wait()
    assert radio.reasons() == [TEST]


def test_a_terminated_vehicle_has_not_tried_its_kill_switch() -> None:
    main, _ = mode_numbers("TERMINATION")
    radio = Radio().wait().wait(kill=True, mode=main << 16).wait()
    assert radio.reasons() == [TEST]


def test_a_kill_without_a_transmitter_is_no_test() -> None:
    assert Radio().wait(rc=False).wait(kill=True, rc=False).wait().reasons() == [TEST]


def test_an_rc_fault_of_the_autopilot_is_a_reason() -> None:
    radio = Radio().wait().wait(kill=True).wait()
    radio.check.on_autopilot(sys_status(rc=True, rc_healthy=False), radio.now)
    assert radio.reasons() == ["autopilot reports an RC fault"]


def test_every_reason_fits_into_a_statustext() -> None:
    for text in (NO_SIGNAL, TEST, "COM_RC_IN_MODE 4 can ignore the RC switches"):
        assert text in sentence(text) and len(sentence(text).encode()) <= TEXT_BYTES


# -- in the link -----------------------------------------------------------------------------------------------------------


def rig(**params: float) -> Rig:
    """Return a link whose vehicle must have a transmitter, and whose parameters are read."""
    made = Rig(preflight={"radio": [0, 3]})
    set_params(made, **GOOD | params)
    return made


def set_params(made: Rig, **params: float) -> None:
    for name, value in params.items():
        raw = mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)
        made.receive(raw)


def test_fault_1_arming_is_refused_until_the_kill_switch_was_tried() -> None:
    made = rig()
    made.fly(2.0, rc=True)
    set_params(made, **GOOD)
    assert made.reasons() == [TEST]
    made.send("router", arm())
    assert not made.arming_passed()
    made.fly(1.5, rc=True, kill=True)
    made.fly(1.5, rc=True)
    assert made.reasons() == []
    made.send("router", arm())
    assert made.arming_passed()


def test_fault_1_the_reason_comes_also_without_parameter_checks() -> None:
    """`preflight: {params: false}` removes COM_RC_IN_MODE from the required parameters, not from this check."""
    made = rig()
    made.fly(1.5, rc=True)
    set_params(made, **GOOD | {"COM_RC_IN_MODE": 4.0})
    assert "COM_RC_IN_MODE 4 can ignore the RC switches" in made.reasons()


def test_the_parameters_of_the_transmitter_are_read_again_and_again() -> None:
    made = rig()
    made.fly(1.0, rc=True)
    set_params(made, **GOOD)
    made.out.clear()
    made.fly(7.0, rc=True)
    assert {m.param_id for m in made.sent("PARAM_REQUEST_READ")} >= set(GOOD)


@pytest.mark.parametrize("radio", [False, True])
def test_rc_channels_are_requested_where_a_transmitter_is_required(radio: bool) -> None:
    streams, asked = StreamRequests(wide=False, radio=radio), set()
    for k in range(2000):
        if (wanted := streams.due(k * 0.05)) is not None:
            asked.add(wanted[0])
            streams.on_ack(mavlink.MAV_RESULT_ACCEPTED, k * 0.05)
    assert (mavlink.MAVLINK_MSG_ID_RC_CHANNELS in asked) is radio


@pytest.mark.parametrize("event", ["reboot", "silence"])
def test_a_reboot_or_another_vehicle_asks_for_a_new_test(event: str) -> None:
    made = rig()
    made.receive(mavlink.MAVLink_system_time_message(0, 60_000))
    for kill in (False, True, False):
        made.fly(1.5, rc=True, kill=kill)
        set_params(made, **GOOD)
    assert made.reasons() == []
    if event == "reboot":
        made.receive(mavlink.MAVLink_system_time_message(0, 500))
    else:
        made.fly(4.0, telemetry=False)
    made.fly(2.0, rc=True)
    set_params(made, **GOOD)
    assert made.reasons() == [TEST]


def test_without_the_demand_nothing_is_said_about_rc() -> None:
    made = Rig()
    made.fly(2.0)
    assert made.reasons() == [] and made.core.system == ID
