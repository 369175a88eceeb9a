"""The landing sequence of one vehicle, on a clock of the test: only the autopilot's telemetry confirms a landing."""

import pytest
from fake_autopilot import AIR, GROUND, MODES
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.emergency.landing_sequence import LandingSequence

COMPONENT = 200
LAND, OFFBOARD, POSCTL = MODES["AUTO.LAND"], MODES["OFFBOARD"], 3 << 16
MODE, NAV_LAND, ARM, INTERVAL, REQUEST_MESSAGE = 176, 21, 400, 511, 512


class Scene:
    """A landing sequence, and messages of its vehicle at chosen times."""

    def __init__(self, action="land", radio=True):
        self.landing = LandingSequence(
            name="uav1", system=1, component=COMPONENT, action=action, now=0.0, radio=radio
        )

    def due(self, now):
        parser = mavlink.MAVLink(None)
        return [m for frame in self.landing.due(now) for m in parser.parse_buffer(frame)]

    def commands(self, now):
        return [m.command for m in self.due(now) if m.get_type() == "COMMAND_LONG"]

    def receive(self, now, *messages, system=1, component=1):
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.landing.on_datagram(b"".join(bytes(m.pack(sender)) for m in messages), now)

    def line(self, now):
        return self.landing.result_line(now)


def heartbeat(armed, mode=OFFBOARD):
    return mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, mode, 4, 3)


def place(state):
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def text(words, severity=3):
    return mavlink.MAVLink_statustext_message(severity, words.encode(), 0, 0)


def ack(command, result, system=253, component=COMPONENT):
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, system, component)


@pytest.fixture
def scene():
    return Scene()


def test_the_landing_is_commanded_first(scene):
    sent = scene.due(0.0)
    assert [m.get_type() for m in sent] == ["HEARTBEAT", "COMMAND_LONG", "COMMAND_LONG"]
    assert sent[0].type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in sent} == {(253, COMPONENT)}
    mode, land = sent[1:]
    assert (mode.command, mode.param1, mode.param2, mode.param3) == (MODE, 1, 4, 6)
    assert land.command == NAV_LAND
    assert {(m.target_system, m.target_component) for m in sent[1:]} == {(1, 1)}


def test_the_land_mode_is_commanded_every_half_second_until_active(scene):
    assert scene.commands(0.0) == [MODE, NAV_LAND]
    assert scene.commands(0.3) == []
    scene.receive(0.4, heartbeat(armed=True), place(AIR))
    assert scene.commands(0.5) == [MODE, NAV_LAND]
    scene.receive(0.6, heartbeat(armed=True, mode=LAND))
    assert scene.commands(1.0) == []
    scene.receive(1.1, heartbeat(armed=True, mode=OFFBOARD))
    assert scene.commands(1.5) == [MODE, NAV_LAND]


def test_an_old_mode_report_does_not_stop_the_commands(scene):
    """The vehicle may have left LAND meanwhile, while no telemetry was received."""
    scene.due(0.0)
    scene.receive(0.1, heartbeat(armed=True, mode=LAND))
    assert MODE not in scene.commands(2.0)
    scene.receive(3.0, place(AIR))  # telemetry, but no flight mode
    assert MODE in scene.commands(4.0)


def test_landed_and_disarmed_is_confirmed_with_its_time(scene):
    scene.receive(0.2, heartbeat(armed=True), place(AIR))
    scene.receive(3.0, heartbeat(armed=True, mode=LAND), place(GROUND))
    assert not scene.landing.confirmed
    scene.receive(4.2, heartbeat(armed=False, mode=LAND))
    assert not scene.landing.confirmed
    scene.receive(5.2, heartbeat(armed=False, mode=LAND))
    assert scene.landing.confirmed and scene.landing.settled(5.2)
    assert scene.line(5.2) == "uav1: landed and disarmed after 4.2 s"


def test_a_vehicle_on_the_ground_is_reported_as_such(scene):
    scene.receive(0.2, heartbeat(armed=False), place(GROUND))
    scene.receive(1.2, heartbeat(armed=False))
    assert scene.line(1.3) == "uav1: already on the ground"
    assert scene.commands(1.7) == []
    assert not scene.landing.settled(2.1) and scene.landing.settled(2.2), "watched from the first report on"


@pytest.mark.parametrize("action", ["land", "kill"])
def test_old_messages_of_a_router_that_hung_confirm_nothing(action):
    """A router that was stopped delivers at once what the vehicle sent before its take-off."""
    scene = Scene(action)
    scene.receive(0.2, heartbeat(armed=True), place(AIR))
    for _ in range(10):
        scene.receive(0.5, heartbeat(armed=False), place(GROUND))
    scene.receive(0.6, heartbeat(armed=False), place(GROUND))
    assert not scene.landing.confirmed
    assert scene.commands(0.6) == [*([ARM] if action == "kill" else []), REQUEST_MESSAGE]
    scene.receive(1.2, heartbeat(armed=True), place(AIR))
    assert scene.commands(1.2)[0] == (MODE if action == "land" else ARM), "it is commanded again"
    scene.receive(1.7, heartbeat(armed=False), place(GROUND))
    assert not scene.landing.confirmed, (
        "the old and the new report are 1 s apart, with an armed one between them"
    )


def test_vehicle_is_commanded_again_if_nothing_follows_its_old_messages(scene):
    scene.receive(0.2, heartbeat(armed=False), place(GROUND))
    assert [scene.commands(at) for at in (0.2, 0.7, 1.2, 1.7)] == [[REQUEST_MESSAGE]] * 4
    assert scene.commands(2.2) == [MODE, NAV_LAND, REQUEST_MESSAGE]


def test_landed_vehicle_is_not_commanded_into_the_land_mode_again(scene):
    """The built-in autopilot leaves LAND when it disarms. In LAND it could not arm again."""
    scene.receive(0.2, heartbeat(armed=True, mode=LAND), place(AIR))
    scene.receive(5.0, heartbeat(armed=False, mode=MODES["AUTO.LOITER"]), place(GROUND))
    sent = [c for at in (5.0, 5.5, 6.0) for c in scene.commands(at)]
    assert set(sent) == {REQUEST_MESSAGE}
    scene.receive(6.1, heartbeat(armed=False, mode=MODES["AUTO.LOITER"]))
    assert scene.landing.confirmed and scene.commands(6.5) == []


def test_confirmation_is_not_delayed_by_more_than_the_time_of_its_heartbeats(scene):
    """Heartbeats are requested, so the confirmation does not wait for the period of the vehicle."""
    scene.receive(0.2, heartbeat(armed=True), place(AIR))
    scene.receive(5.0, heartbeat(armed=False, mode=LAND), place(GROUND))
    requests = []
    for hundredth in range(500, 640):
        at = hundredth / 100
        if REQUEST_MESSAGE in scene.commands(at):
            requests.append(at)
            scene.receive(at + 0.01, heartbeat(armed=False, mode=LAND))
    assert requests == pytest.approx([5.0, 5.5, 6.0])
    assert scene.landing.confirmed


@pytest.mark.parametrize(
    "messages",
    [
        [heartbeat(armed=False)],
        [place(GROUND)],
        [heartbeat(armed=False), place(AIR)],
        [heartbeat(armed=True), place(GROUND)],
        [heartbeat(armed=False), place(mavlink.MAV_LANDED_STATE_LANDING)],
        [heartbeat(armed=False), place(0)],
    ],
)
def test_incomplete_telemetry_confirms_nothing(scene, messages):
    scene.receive(0.2, *messages)
    assert not scene.landing.confirmed


@pytest.mark.parametrize(("system", "component"), [(2, 1), (1, 191), (255, 190)])
def test_messages_of_other_components_confirm_nothing(scene, system, component):
    scene.receive(0.2, heartbeat(armed=False), place(GROUND), system=system, component=component)
    assert not scene.landing.confirmed
    assert scene.line(1.0) == "uav1: NOT CONFIRMED: no telemetry received"


def test_an_armed_vehicle_on_the_ground_is_disarmed_without_force(scene):
    scene.receive(0.2, heartbeat(armed=True, mode=LAND), place(GROUND))
    assert ARM not in scene.commands(3.1)
    scene.receive(3.2, heartbeat(armed=True, mode=LAND))
    [disarm] = [m for m in scene.due(3.7) if m.get_type() == "COMMAND_LONG"]
    assert (disarm.command, disarm.param1, disarm.param2) == (ARM, 0, 0)


def test_it_is_never_disarmed_in_the_air_or_in_doubt(scene):
    for i in range(100):
        assert ARM not in scene.commands(0.5 * i)
    scene.receive(51.0, heartbeat(armed=True, mode=LAND), place(GROUND))
    scene.receive(53.0, place(AIR))
    scene.receive(54.5, place(GROUND))
    assert ARM not in scene.commands(57.0)
    assert ARM in scene.commands(58.0)


def test_missing_telemetry_is_requested(scene):
    assert INTERVAL not in scene.commands(0.0)
    asked = [m.param1 for m in scene.due(1.1) if m.get_type() == "COMMAND_LONG" and m.command == INTERVAL]
    assert asked == [0, 245]
    scene.receive(1.2, heartbeat(armed=True))
    asked = [m.param1 for m in scene.due(1.7) if m.get_type() == "COMMAND_LONG" and m.command == INTERVAL]
    assert asked == [245]


def test_a_refusal_is_reported_and_the_command_repeated(scene):
    scene.receive(0.2, heartbeat(armed=True), place(AIR), ack(MODE, mavlink.MAV_RESULT_TEMPORARILY_REJECTED))
    assert MODE in scene.commands(0.5)
    assert scene.line(12.2) == (
        "uav1: NOT CONFIRMED: no telemetry for 12 s, last state: armed, in the air, mode OFFBOARD, LAND mode refused: temporarily rejected"
    )
    scene.receive(13.0, ack(MODE, mavlink.MAV_RESULT_ACCEPTED))
    assert "refused" not in scene.line(13.0)


@pytest.mark.parametrize(
    "message", [ack(MODE, 2, system=1, component=191), ack(MODE, 2, component=201), ack(511, 2)]
)
def test_acknowledgements_for_others_are_ignored(scene, message):
    scene.receive(0.2, heartbeat(armed=True), message)
    assert scene.landing.refusal == ""


def test_a_vehicle_armed_again_is_landed_again(scene):
    for second in (0.2, 1.2):
        scene.receive(second, heartbeat(armed=False), place(GROUND))
    assert scene.landing.confirmed
    scene.receive(2.0, heartbeat(armed=True))
    assert not scene.landing.confirmed
    assert MODE in scene.commands(2.1)


def test_missing_telemetry_is_reported_as_unknown(scene):
    scene.receive(1.0, place(AIR))
    assert (
        scene.line(3.0)
        == "uav1: NOT CONFIRMED: no telemetry for 2 s, last state: arming state unknown, in the air, mode unknown"
    )


def test_kill_forces_the_motors_off_until_confirmed():
    scene = Scene("kill")
    [kill] = [m for m in scene.due(0.0) if m.get_type() == "COMMAND_LONG"]
    assert (kill.command, kill.param1, kill.param2) == (ARM, 0, 21196)
    scene.receive(0.3, heartbeat(armed=True), place(AIR))
    assert scene.commands(0.5) == [ARM]
    scene.receive(0.8, heartbeat(armed=False))
    assert ARM in scene.commands(1.0), "the report may be old"
    scene.receive(1.8, heartbeat(armed=False))
    assert scene.landing.confirmed
    assert scene.line(2.0) == "uav1: motors stopped after 0.8 s"


# review fault 5


@pytest.mark.parametrize("action", ["land", "kill"])
@pytest.mark.parametrize("before", [LAND, OFFBOARD])
def test_a_vehicle_that_a_pilot_takes_is_not_commanded(action, before):
    scene = Scene(action)
    assert scene.commands(0.0)
    scene.receive(0.4, heartbeat(armed=True, mode=before), place(AIR))
    scene.commands(0.5)
    scene.receive(1.4, heartbeat(armed=True, mode=POSCTL))
    for i in range(200):
        at = 1.5 + 0.1 * i
        if i < 100:
            scene.receive(at, heartbeat(armed=True, mode=POSCTL), place(AIR))
        assert scene.commands(at) == [], "also after the telemetry has ended"
    assert scene.landing.take_events() == ["pilot has control (POSCTL): not commanded"]
    assert not scene.landing.confirmed
    assert scene.line(11.5) == (
        "uav1: NOT CONFIRMED: pilot has control (POSCTL): not commanded; armed, in the air, mode POSCTL"
    )


def test_the_pilots_landing_is_reported_by_the_autopilot(scene):
    scene.receive(0.4, heartbeat(armed=True, mode=LAND), place(AIR))
    scene.receive(1.4, heartbeat(armed=True, mode=POSCTL))
    scene.receive(9.0, heartbeat(armed=True, mode=POSCTL), place(GROUND))
    assert not scene.landing.confirmed
    assert scene.commands(13.0) == [], "an armed vehicle on the ground is the pilot's too"
    for second in (14.0, 15.0):
        scene.receive(second, heartbeat(armed=False, mode=POSCTL))
    assert scene.line(15.0) == "uav1: landed and disarmed after 14.0 s"


def test_a_vehicle_is_not_commanded_directly_while_a_pilot_may_have_control(scene):
    assert scene.landing.may_bypass
    scene.receive(0.4, heartbeat(armed=True, mode=POSCTL), place(AIR))
    assert not scene.landing.may_bypass, "from the start: link and router refuse too"
    scene.receive(1.4, heartbeat(armed=True, mode=LAND))
    assert scene.landing.may_bypass
    scene.receive(2.4, heartbeat(armed=False, mode=POSCTL))
    assert scene.landing.may_bypass


def test_a_refusal_of_the_router_forbids_direct_commands(scene):
    router = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    scene.landing.on_refusal(text("land-all has control").pack(router))
    assert scene.landing.may_bypass
    scene.landing.on_refusal(text("pilot has control").pack(router))
    assert not scene.landing.may_bypass
    scene.receive(1.4, heartbeat(armed=True, mode=LAND))
    assert scene.landing.may_bypass


def test_a_vehicle_in_a_manual_mode_from_the_start_is_landed(scene):
    for i in range(10):
        scene.receive(0.5 * i, heartbeat(armed=True, mode=POSCTL), place(AIR))
        assert scene.commands(0.5 * i) == [MODE, NAV_LAND]


def test_a_vehicle_that_its_pilot_gives_back_is_landed_again(scene):
    scene.receive(0.4, heartbeat(armed=True, mode=OFFBOARD), place(AIR))
    scene.receive(1.4, heartbeat(armed=True, mode=POSCTL))
    scene.receive(5.0, heartbeat(armed=True, mode=OFFBOARD))
    assert scene.commands(5.1) == [], "a heartbeat may be late"
    scene.receive(6.0, heartbeat(armed=True, mode=OFFBOARD))
    assert scene.commands(6.6) == [MODE, NAV_LAND]
    assert scene.landing.take_events()[1:] == ["pilot has left manual control (OFFBOARD): commanded again"]


def test_late_heartbeats_of_another_path_give_no_command_to_a_pilot(scene):
    scene.receive(0.4, heartbeat(armed=True, mode=LAND), place(AIR))
    for second in range(1, 20):
        scene.receive(second, heartbeat(armed=True, mode=POSCTL))
        scene.receive(second + 0.1, heartbeat(armed=True, mode=LAND if second < 3 else POSCTL))
        for tenth in range(10):
            assert scene.commands(second + tenth / 10) == []


def test_a_pilot_who_arms_on_the_ground_is_left_alone(scene):
    scene.receive(0.4, heartbeat(armed=False, mode=POSCTL), place(GROUND))
    scene.receive(1.0, heartbeat(armed=True, mode=POSCTL))
    assert scene.commands(1.5) == []


def test_missing_telemetry_of_a_pilots_vehicle_is_requested(scene):
    scene.receive(0.4, heartbeat(armed=True, mode=OFFBOARD))
    scene.receive(1.4, heartbeat(armed=True, mode=POSCTL))
    assert scene.commands(1.5) == [INTERVAL]


def test_the_reason_of_a_refusal_is_in_the_result(scene):
    """A hardware link refuses a command in the name of the autopilot, and sends the text once in a while."""
    scene.receive(0.2, text("pilot has control"), ack(MODE, 1), ack(NAV_LAND, 1))
    assert scene.line(0.3) == (
        "uav1: NOT CONFIRMED: no telemetry received; land command refused: temporarily rejected (pilot has control)"
    )
    for i in range(20):
        scene.receive(0.5 * i, ack(NAV_LAND, 1))
    assert "(pilot has control)" in scene.line(10.0)
    scene.receive(10.5, text("info", severity=6), ack(MODE, 2))
    assert scene.landing.refusal == "LAND mode refused: denied"


messages = st.sampled_from(
    [ack(command, result) for command in (MODE, NAV_LAND, ARM) for result in (0, 1, 5)]
    + [text("pilot has control")]
)


@given(st.lists(messages, max_size=30), st.sampled_from(["land", "kill"]))
def test_acknowledgements_change_texts_only(received, action):
    """Two land-all may have the same component id, so an acknowledgement may belong to the other one."""
    scenes = Scene(action), Scene(action)
    for i, message in enumerate(received):
        now = 0.4 * i
        state = [heartbeat(armed=i < 20, mode=LAND), place(AIR if i < 10 else GROUND)] if i % 4 == 0 else []
        scenes[0].receive(now, message, *state)
        scenes[1].receive(now, *state)
        assert scenes[0].landing.due(now) == scenes[1].landing.due(now)
        assert scenes[0].landing.confirmed == scenes[1].landing.confirmed
        assert scenes[0].landing.reported == scenes[1].landing.reported


@given(st.lists(st.binary(max_size=80), max_size=20))
def test_random_bytes_confirm_nothing(datagrams):
    scene = Scene()
    for i, data in enumerate(datagrams):
        scene.landing.on_datagram(data, float(i))
        scene.landing.due(float(i))
    assert not scene.landing.confirmed


def rc_channels(count=16):
    return mavlink.MAVLink_rc_channels_message(0, count, *[1500] * 18, 80)


def test_manual_mode_without_radio_is_commanded_until_stick_positions_arrive():
    scene = Scene(radio=False)
    scene.receive(0.1, heartbeat(armed=True), place(AIR), rc_channels(0))
    scene.receive(1.1, heartbeat(armed=True, mode=POSCTL))  # a failsafe
    assert MODE in scene.commands(1.2)
    scene.receive(2.0, rc_channels(), heartbeat(armed=True, mode=POSCTL))
    assert MODE not in scene.commands(2.1)
    assert "pilot has control (POSCTL)" in scene.line(2.1)


@pytest.mark.parametrize("result", [0, 1, 2, 4])
def test_replies_to_another_land_all_with_the_same_id_change_no_command(result):
    """Two processes may have the same component id (190 + pid modulo 60), and receive each other's acknowledgements."""
    alone, shared = Scene(), Scene()
    for step in range(40):
        now = 0.25 * step
        telemetry = (
            heartbeat(armed=step < 30, mode=LAND if step > 4 else OFFBOARD),
            place(AIR if step < 20 else GROUND),
        )
        for scene in (alone, shared):
            scene.receive(now, *telemetry)
        shared.receive(now, *(ack(command, result) for command in (MODE, NAV_LAND, ARM, INTERVAL)))
        assert shared.commands(now) == alone.commands(now)
        assert shared.landing.confirmed is alone.landing.confirmed
    assert shared.landing.confirmed
