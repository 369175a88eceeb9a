"""The state machine of one vehicle, with a clock of its own: nothing is confirmed that the autopilot did not say."""

import pytest
from fakes import AIR, GROUND, LAND, OFFBOARD
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.emergency.landing_sequence import LandingSequence

COMPONENT = 200
MODE, NAV_LAND, ARM, INTERVAL = 176, 21, 400, 511


class Scene:
    """A landing and its vehicle's words at chosen times."""

    def __init__(self, action="land"):
        self.landing = LandingSequence(name="uav1", system=1, component=COMPONENT, action=action, now=0.0)
        self.voice = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def due(self, now):
        parser = mavlink.MAVLink(None)
        return [m for frame in self.landing.due(now) for m in parser.parse_buffer(frame)]

    def commands(self, now):
        return [m.command for m in self.due(now) if m.get_type() == "COMMAND_LONG"]

    def says(self, now, *messages, system=1, component=1):
        voice = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.landing.on_datagram(b"".join(bytes(m.pack(voice)) for m in messages), now)

    def line(self, now):
        return self.landing.result_line(now)


def beat(armed, mode=OFFBOARD):
    return mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, mode, 4, 3)


def place(state):
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def ack(command, result, system=253, component=COMPONENT):
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, system, component)


@pytest.fixture
def scene():
    return Scene()


def test_the_first_thing_sent_is_the_landing(scene):
    sent = scene.due(0.0)
    assert [m.get_type() for m in sent] == ["HEARTBEAT", "COMMAND_LONG", "COMMAND_LONG"]
    assert sent[0].type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in sent} == {(253, COMPONENT)}
    mode, land = sent[1:]
    assert (mode.command, mode.param1, mode.param2, mode.param3) == (MODE, 1, 4, 6)
    assert land.command == NAV_LAND
    assert {(m.target_system, m.target_component) for m in sent[1:]} == {(1, 1)}


def test_it_is_sent_again_each_half_second_until_the_mode_is_land(scene):
    assert scene.commands(0.0) == [MODE, NAV_LAND]
    assert scene.commands(0.3) == []
    scene.says(0.4, beat(armed=True), place(AIR))
    assert scene.commands(0.5) == [MODE, NAV_LAND]
    scene.says(0.6, beat(armed=True, mode=LAND))
    assert scene.commands(1.0) == []
    scene.says(1.1, beat(armed=True, mode=OFFBOARD))
    assert scene.commands(1.5) == [MODE, NAV_LAND]


def test_a_mode_that_was_heard_long_ago_is_commanded_again(scene):
    """The vehicle may have been taken out of LAND meanwhile, while nothing of it came through."""
    scene.due(0.0)
    scene.says(0.1, beat(armed=True, mode=LAND))
    assert MODE not in scene.commands(2.0)
    scene.says(3.0, place(AIR))  # its height is heard, its mode is not
    assert MODE in scene.commands(4.0)


def test_down_and_disarmed_is_confirmed_with_its_time(scene):
    scene.says(0.2, beat(armed=True), place(AIR))
    scene.says(3.0, beat(armed=True, mode=LAND), place(GROUND))
    assert not scene.landing.confirmed
    scene.says(4.2, beat(armed=False, mode=LAND))
    assert scene.landing.confirmed
    assert scene.line(5.0) == "uav1: landed and disarmed after 4.2 s"


def test_one_that_stood_there_is_already_on_the_ground(scene):
    scene.says(0.2, beat(armed=False), place(GROUND))
    assert scene.line(0.3) == "uav1: already on the ground"
    assert scene.commands(1.0) == []


@pytest.mark.parametrize(
    "words",
    [
        [beat(armed=False)],
        [place(GROUND)],
        [beat(armed=False), place(AIR)],
        [beat(armed=True), place(GROUND)],
        [beat(armed=False), place(mavlink.MAV_LANDED_STATE_LANDING)],
        [beat(armed=False), place(0)],
    ],
)
def test_half_a_proof_is_none(scene, words):
    scene.says(0.2, *words)
    assert not scene.landing.confirmed


@pytest.mark.parametrize(("system", "component"), [(2, 1), (1, 191), (255, 190)])
def test_another_speakers_words_prove_nothing(scene, system, component):
    scene.says(0.2, beat(armed=False), place(GROUND), system=system, component=component)
    assert not scene.landing.confirmed
    assert scene.line(1.0) == "uav1: NOT CONFIRMED: no telemetry received"


def test_standing_armed_for_three_seconds_it_is_disarmed_without_force(scene):
    scene.says(0.2, beat(armed=True, mode=LAND), place(GROUND))
    assert ARM not in scene.commands(3.1)
    scene.says(3.2, beat(armed=True, mode=LAND))
    [disarm] = [m for m in scene.due(3.7) if m.get_type() == "COMMAND_LONG"]
    assert (disarm.command, disarm.param1, disarm.param2) == (ARM, 0, 0)


def test_it_is_never_disarmed_in_the_air_or_where_nobody_knows(scene):
    for i in range(100):
        assert ARM not in scene.commands(0.5 * i)
    scene.says(51.0, beat(armed=True, mode=LAND), place(GROUND))
    scene.says(53.0, place(AIR))
    scene.says(54.5, place(GROUND))
    assert ARM not in scene.commands(57.0)
    assert ARM in scene.commands(58.0)


def test_what_is_not_heard_is_asked_for(scene):
    assert INTERVAL not in scene.commands(0.0)
    asked = [m.param1 for m in scene.due(1.1) if m.get_type() == "COMMAND_LONG" and m.command == INTERVAL]
    assert asked == [0, 245]
    scene.says(1.2, beat(armed=True))
    asked = [m.param1 for m in scene.due(1.7) if m.get_type() == "COMMAND_LONG" and m.command == INTERVAL]
    assert asked == [245]


def test_a_refusal_is_told_and_it_tries_on(scene):
    scene.says(0.2, beat(armed=True), place(AIR), ack(MODE, mavlink.MAV_RESULT_TEMPORARILY_REJECTED))
    assert MODE in scene.commands(0.5)
    assert scene.line(12.2) == (
        "uav1: NOT CONFIRMED: no telemetry for 12 s, last state: armed, in the air, mode OFFBOARD, LAND mode refused: temporarily rejected"
    )
    scene.says(13.0, ack(MODE, mavlink.MAV_RESULT_ACCEPTED))
    assert "refused" not in scene.line(13.0)


@pytest.mark.parametrize(
    "message", [ack(MODE, 2, system=1, component=191), ack(MODE, 2, component=201), ack(511, 2)]
)
def test_answers_to_others_or_of_no_matter_are_not_told(scene, message):
    scene.says(0.2, beat(armed=True), message)
    assert scene.landing.refusal == ""


def test_one_that_is_armed_again_is_landed_again(scene):
    scene.says(0.2, beat(armed=False), place(GROUND))
    assert scene.landing.confirmed
    scene.says(1.0, beat(armed=True))
    assert not scene.landing.confirmed
    assert MODE in scene.commands(1.1)


def test_what_is_not_known_is_called_unknown(scene):
    scene.says(1.0, place(AIR))
    assert (
        scene.line(3.0)
        == "uav1: NOT CONFIRMED: no telemetry for 2 s, last state: arming state unknown, in the air, mode unknown"
    )


def test_killing_forces_the_motors_off_until_they_are():
    scene = Scene("kill")
    [kill] = [m for m in scene.due(0.0) if m.get_type() == "COMMAND_LONG"]
    assert (kill.command, kill.param1, kill.param2) == (ARM, 0, 21196)
    scene.says(0.3, beat(armed=True), place(AIR))
    assert scene.commands(0.5) == [ARM]
    scene.says(0.8, beat(armed=False))
    assert scene.landing.confirmed
    assert scene.line(1.0) == "uav1: motors stopped after 0.8 s"


@given(st.lists(st.binary(max_size=80), max_size=20))
def test_any_bytes_are_survived_and_prove_nothing(datagrams):
    scene = Scene()
    for i, data in enumerate(datagrams):
        scene.landing.on_datagram(data, float(i))
        scene.landing.due(float(i))
    assert not scene.landing.confirmed
