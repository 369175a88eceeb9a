"""Tests of the parameters of replayed vehicles, with pymavlink as the client."""

from __future__ import annotations

import struct
from pathlib import Path

from pymavlink.dialects.v20 import common as mavlink

from arena.replay.parameters import ParameterHistory, ParameterReplies, Stored, parameters_of_ulog
from arena.wire.mavlink_codec import Codec
from arena.wire.qgc_params import INT32, REAL32

CLIENT = Codec(255, 190)
LARGE = 0x7F800001  # the bits of a signalling NaN
INITIAL = {"MPC_XY_P": Stored(0.95, REAL32), "COM_RC_IN_MODE": Stored(LARGE, INT32)}


def replies(initial: dict[str, Stored] | None = None) -> ParameterReplies:
    return ParameterReplies([ParameterHistory(INITIAL if initial is None else initial)], [7])


def values(datagrams: list[bytes]) -> dict[str, tuple[float, int, int, int]]:
    """Return name -> (value, type, index, count) of all PARAM_VALUEs, with integers decoded from their bytes."""
    found = {}
    for message in [m for datagram in datagrams for m in Codec(9, 9).parse(datagram)]:
        assert (message.get_srcSystem(), message.get_srcComponent()) == (7, 1)
        layout = "<i" if message.param_type == INT32 else "<f"
        raw = bytes(message.get_msgbuf()[10:14])  # behind the head of the frame
        (value,) = struct.unpack(layout, raw)
        found[message.param_id] = (value, message.param_type, message.param_index, message.param_count)
    return found


def test_requested_list_has_every_parameter_with_its_index() -> None:
    initial = {f"P{k:03}": Stored(float(k), REAL32) for k in range(100)}
    server = replies(initial)
    assert server.next_values(0) == []
    assert server.on_datagram(0, CLIENT.pack(mavlink.MAVLink_param_request_list_message(7, 1)), 0) == []
    sent = []
    while datagrams := server.next_values(0):
        assert all(vehicle == 0 and len(data) < 1000 for vehicle, data in datagrams)
        sent += [data for _, data in datagrams]
    assert values(sent) == {f"P{k:03}": (float(k), REAL32, k, 100) for k in range(100)}


def test_parameter_is_read_by_name_and_by_index() -> None:
    for name, index in ((b"COM_RC_IN_MODE", -1), (b"", 0)):
        request = mavlink.MAVLink_param_request_read_message(7, 1, name, index)
        assert values(replies().on_datagram(0, CLIENT.pack(request), 0)) == {
            "COM_RC_IN_MODE": (LARGE, INT32, 0, 2)
        }


def test_unknown_parameter_and_index_get_no_reply() -> None:
    for name, index in ((b"MPC_Z_P", -1), (b"", 2)):
        request = mavlink.MAVLink_param_request_read_message(7, 1, name, index)
        assert replies().on_datagram(0, CLIENT.pack(request), 0) == []


def test_write_is_answered_with_the_recorded_value() -> None:
    write = mavlink.MAVLink_param_set_message(7, 1, b"MPC_XY_P", 2.0, REAL32)
    (value,) = values(replies().on_datagram(0, CLIENT.pack(write), 0)).values()
    assert value[0] == struct.unpack("<f", struct.pack("<f", 0.95))[0]


def test_value_is_that_of_the_place_in_the_record() -> None:
    history = ParameterHistory(INITIAL)
    for time_ns, value in ((10, 0.95), (20, 1.5), (30, 2.5)):
        message = mavlink.MAVLink_param_value_message(b"MPC_XY_P", value, REAL32, 900, 17)
        history.add(time_ns, Codec(7, 1).pack(message))
    history.add(40, Codec(7, 1).pack(mavlink.MAVLink_param_value_message(b"_HASH_CHECK", 1.0, 5, 900, 65535)))
    found = [history.at("MPC_XY_P", t) for t in (0, 19, 20, 29, 35)]
    assert [round(stored.value, 3) for stored in found if stored] == [0.95, 0.95, 1.5, 1.5, 2.5]
    assert history.names == ["COM_RC_IN_MODE", "MPC_XY_P"]


def test_value_that_was_first_read_in_flight_is_also_the_value_before() -> None:
    history = ParameterHistory()
    message = mavlink.MAVLink_param_value_message(b"MPC_XY_P", 1.5, REAL32, 900, 17)
    history.add(10, Codec(7, 1).pack(message))
    assert history.at("MPC_XY_P", 0) == Stored(1.5, REAL32)


def test_values_of_other_components_are_not_taken() -> None:
    history = ParameterHistory()
    history.add(0, Codec(7, 154).pack(mavlink.MAVLink_param_value_message(b"GIMBAL_P", 1.5, REAL32, 9, 1)))
    assert history.names == []


def test_parameters_of_a_file_that_is_not_a_ulog_are_unknown(tmp_path: Path) -> None:
    (tmp_path / "uav1.ulg").write_bytes(b"time.seconds\n")
    assert parameters_of_ulog(tmp_path / "uav1.ulg") == {}
    assert parameters_of_ulog(tmp_path / "missing.ulg") == {}
