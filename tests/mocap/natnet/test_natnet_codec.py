"""NatNet bytes: against annotated golden ones, against an independent client's parser, and against nonsense."""

from __future__ import annotations

import struct
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.server_info import ServerInfo as PeerServerInfo
from natnet.version import Version

from arena.errors import WireError
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet import echo

BODIES = (
    natnet.Body(
        streaming_id=1, position=(1.0, 2.0, 3.0), quat_xyzw=(0.0, 0.0, 0.5, 0.8660254), mean_error_m=0.25
    ),
    natnet.Body(streaming_id=7, position=(-1.5, 0.25, 0.5), quat_xyzw=(0.5, 0.5, 0.5, 0.5), tracked=False),
)
FRAME = natnet.Frame(number=12345, timestamp_s=68.5, exposure_ticks=685_000_000, bodies=BODIES)
VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]

GOLDEN_31 = bytes.fromhex(
    "0700"
    "9a00"  # frame of data, 154 bytes
    "39300000"  # frame 12345
    "00000000"
    "00000000"  # no marker sets, no loose markers
    "02000000"  # two rigid bodies
    "01000000"
    "0000803f0000004000004040"
    "00000000000000000000003fd7b35d3f"
    "0000803e"
    "0100"
    "07000000"
    "0000c0bf0000803e0000003f"
    "0000003f0000003f0000003f0000003f"
    "00000000"
    "0000"
    "00000000"
    "00000000"
    "00000000"
    "00000000"  # skeletons, labelled markers, force plates, devices
    "00000000"
    "00000000"
    "0000000000205140"  # timecode, sub frame, 68.5 s
    "4045d42800000000"
    "4045d42800000000"
    "4045d42800000000"  # ticks: exposure, received, sent
    "0000"
    "00000000"  # parameters, end
)


def test_golden_frame_is_encoded_and_decoded():
    assert natnet.encode_frame(FRAME, (3, 1)).hex() == GOLDEN_31.hex()
    again = natnet.decode_frame(GOLDEN_31, (3, 1))
    assert again.number == 12345
    assert again.timestamp_s == 68.5
    assert again.bodies[0].position == (1.0, 2.0, 3.0)
    assert again.bodies[1].tracked is False


@pytest.mark.parametrize("version", VERSIONS)
def test_independent_client_decodes_frames(version):
    peer = DataFrame.read_from_buffer(
        PacketBuffer(natnet.encode_frame(FRAME, version)[4:]), Version(*version)
    )
    assert peer.prefix.frame_number == 12345
    assert [b.id_num for b in peer.rigid_bodies] == [1, 7]
    assert peer.rigid_bodies[0].pos == pytest.approx((1.0, 2.0, 3.0))
    assert peer.rigid_bodies[0].rot == pytest.approx((0.0, 0.0, 0.5, 0.8660254))
    assert [b.tracking_valid for b in peer.rigid_bodies] == [True, False]
    assert peer.suffix.timestamp == 68.5
    assert peer.suffix.stamp_camera_mid_exposure == 685_000_000


@pytest.mark.parametrize("version", VERSIONS)
def test_independent_client_decodes_models_and_server_info(version):
    models = natnet.encode_models([(1, "uav1"), (7, "aero2")], version)
    peer = DataDescriptions.read_from_buffer(PacketBuffer(models[4:]), Version(*version))
    assert [(b.id_num, b.name) for b in peer.rigid_bodies] == [(1, "uav1"), (7, "aero2")]
    info = natnet.ServerInfo(
        name="arena",
        app_version=(4, 1, 0, 0),
        version=version,
        clock_hz=10_000_000,
        data_port=1511,
        group="239.255.42.99",
    )
    data = natnet.encode_server_info(info)
    seen = PeerServerInfo.read_from_buffer(PacketBuffer(data[4:]), Version(*version))
    assert seen.application_name == "arena"
    assert natnet.decode_server_info(data) == info


@pytest.mark.parametrize("version", VERSIONS)
def test_only_wanted_bodies_of_a_frame_are_unpacked(version):
    data = natnet.encode_frame(FRAME, version)
    again = natnet.decode_frame(data, version, wanted={7})
    assert [b.streaming_id for b in again.bodies] == [7]
    assert again.exposure_ticks == FRAME.exposure_ticks
    models = natnet.decode_models(natnet.encode_models([(3, "a"), (4, "b")], version), version)
    assert [(i, m.name) for i, m in models] == [(3, "a"), (4, "b")]


@pytest.mark.parametrize("version", VERSIONS)
def test_markers_of_a_body_belong_to_its_definition(version):
    def models(*markers):
        return dict(
            natnet.decode_models(natnet.encode_models([(1, "uav1"), (2, "uav2")], version, markers), version)
        )

    first, moved = models((0.1, 0.0, 0.02), (0.0, 0.1, 0.02)), models((0.1, 0.0, 0.02), (0.0, 0.1, 0.03))
    assert [m.markers for m in first.values()] == [2, 2] and [m.markers for m in models().values()] == [0, 0]
    assert first == models((0.1, 0.0, 0.02), (0.0, 0.1, 0.02)) and first[1] != moved[1]
    data = natnet.encode_models([(1, "uav1")], version, [(0.1, 0.0, 0.02)])
    (peer,) = DataDescriptions.read_from_buffer(PacketBuffer(data[4:]), Version(*version)).rigid_bodies
    assert peer.name == "uav1" and peer.markers[0].pos == pytest.approx((0.1, 0.0, 0.02))


def test_other_sections_of_a_sized_frame_are_skipped():
    """4.1: every section says its size, so what is not known is skipped whole."""
    body = struct.pack("<i3f4ffh", 9, 1, 2, 3, 0, 0, 0, 1, 0, 1)
    markers = b"set\0" + struct.pack("<i3f", 1, 0, 0, 0)
    sections = struct.pack("<ii", 1, len(markers)) + markers + struct.pack("<ii3f", 1, 12, 1, 1, 1)
    sections += (
        struct.pack("<ii", 1, len(body))
        + body
        + struct.pack("<ii", 1, 5)
        + b"skele"
        + struct.pack("<ii", 0, 0) * 4
    )
    payload = (
        struct.pack("<i", 5)
        + sections
        + struct.pack("<IIdQQQ", 0, 0, 1.5, 3, 3, 3)
        + struct.pack("<IIhi", 1, 0, 0, 0)
    )
    frame = natnet.decode_frame(natnet.packet(natnet.FRAME, payload), (4, 1))
    assert frame.bodies[0].streaming_id == 9
    assert frame.timestamp_s == 1.5


@given(st.binary(max_size=400))
def test_random_bytes_raise_only_wire_errors(data):
    for decode in (natnet.message_of, natnet.decode_server_info):
        with suppress(WireError):
            decode(data)
    for version in VERSIONS:
        for message, decode in ((natnet.FRAME, natnet.decode_frame), (natnet.MODELDEF, natnet.decode_models)):
            with suppress(WireError):
                decode(natnet.packet(message, data), version)


@given(st.integers(0, 150), st.integers(0, 255), st.sampled_from(VERSIONS))
def test_damaged_frame_raises_only_wire_errors(at, value, version):
    data = bytearray(natnet.encode_frame(FRAME, version))
    data[at % len(data)] = value
    for cut in (len(data), at % len(data)):
        with suppress(WireError):
            natnet.decode_frame(bytes(data[:cut]), version)


def test_newer_minor_version_is_decoded_only_with_the_known_layout():
    data = natnet.encode_frame(FRAME, (4, 4))
    assert natnet.decode_frame(data, (4, 4)).bodies == natnet.decode_frame(data, (4, 2)).bodies
    at = len(data) - 54  # one more empty section before the time stamps
    longer = natnet.packet(natnet.FRAME, data[4:at] + bytes(8) + data[at:])
    with pytest.raises(WireError, match=r"4\.4 frame: got 62 bytes"):
        natnet.decode_frame(longer, (4, 4))
    understood = [
        v for v in ((2, 10), (3, 0), (3, 1), (3, 2), (4, 0), (4, 2), (4, 4), (5, 0)) if natnet.is_supported(v)
    ]
    assert understood == [(3, 0), (3, 1), (4, 0), (4, 2), (4, 4)]


@pytest.mark.parametrize(("said", "sent"), [((4, 1), (3, 1)), ((3, 1), (4, 1))])
def test_frames_of_another_layout_give_no_pose(said, sent):
    with suppress(WireError):
        assert natnet.decode_frame(natnet.encode_frame(FRAME, sent), said).bodies == ()


def test_echo_request_and_response_have_the_bytes_of_the_protocol():
    assert echo.encode_echo_request(5) == bytes.fromhex("0c0008000500000000000000")
    response = echo.encode_echo_response(5, 685_000_000)
    assert response == bytes.fromhex("0d00100005000000000000004045d42800000000")
    assert echo.decode_echo_request(echo.encode_echo_request(5)) == 5
    assert echo.decode_echo_response(response) == (5, 685_000_000)
    with pytest.raises(WireError):
        echo.decode_echo_response(natnet.packet(natnet.ECHO_RESPONSE, bytes(15)))
