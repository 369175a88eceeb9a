"""The message AVAILABLE_MODES, against pymavlink's development dialect."""

from __future__ import annotations

from pymavlink.dialects.v20 import common, development

from arena.wire import px4_mode
from arena.wire.mavlink_codec import Codec


def decoded(message):
    return development.MAVLink(None).decode(bytearray(Codec(7, 1).pack(message)))


def test_available_modes_is_read_by_the_development_dialect():
    given = px4_mode.AvailableMode(
        custom_mode=6 << 16, index=3, count=9, properties=px4_mode.ADVANCED, standard=0, name="Offboard"
    )
    m = decoded(given)
    assert m.get_type() == "AVAILABLE_MODES"
    assert (m.mode_index, m.number_modes, m.properties, m.mode_name) == (3, 9, 1, "Offboard")


def test_sequence_numbers_are_shared_with_pymavlinks_messages():
    codec = Codec(7, 1)
    one = codec.pack(px4_mode.AvailableMode(custom_mode=0, index=1, count=1))
    two = codec.pack(common.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3))
    assert (one[4], two[4]) == (0, 1)


def test_the_common_dialect_still_lacks_the_messages():
    """When it does not any more, this module has done its work."""
    assert not {px4_mode.AVAILABLE_MODES, px4_mode.CURRENT_MODE} & set(common.mavlink_map)


def test_orbit_is_a_mode_of_its_own_and_not_a_manual_mode():
    assert px4_mode.mode_words(3 << 16 | 1 << 24) == "ORBIT"
    assert px4_mode.mode_words(3 << 16) == px4_mode.mode_words(3 << 16 | 2 << 24) == "POSCTL"
    assert px4_mode.mode_numbers("ORBIT") == (3, 1)
    assert "ORBIT" not in px4_mode.MANUAL_MODES
