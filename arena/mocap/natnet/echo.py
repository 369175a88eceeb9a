"""NatNet's echo messages, with which a client compares the server's clock with its own clock.

The server returns the client's number and its own time at the arrival of the request, both 64 bits. (The layout follows public
NatNet clients.)
"""

from __future__ import annotations

import struct

from arena.errors import WireError
from arena.kernels.natnet_payload import payload_of
from arena.mocap.natnet import codec

_ECHO, _ECHOED = struct.Struct("<Q"), struct.Struct("<QQ")


def encode_echo_request(stamp: int) -> bytes:
    """Return an ECHO_REQUEST packet. stamp: 64-bit number that the server sends back."""
    return codec.packet(codec.ECHO_REQUEST, _ECHO.pack(stamp))


def decode_echo_request(data: bytes) -> int:
    """Return the stamp of an ECHO_REQUEST packet. Raises WireError."""
    return int(_echo_numbers(data, codec.ECHO_REQUEST, _ECHO)[0])


def encode_echo_response(stamp: int, received_ticks: int) -> bytes:
    """Return the reply to an ECHO_REQUEST. received_ticks: arrival, in ticks of the server's clock."""
    return codec.packet(codec.ECHO_RESPONSE, _ECHOED.pack(stamp, received_ticks))


def decode_echo_response(data: bytes) -> tuple[int, int]:
    """Decode an ECHO_RESPONSE packet. Return the stamp of the request, and its arrival in server clock ticks.

    Raises WireError for an invalid packet.
    """
    stamp, ticks = _echo_numbers(data, codec.ECHO_RESPONSE, _ECHOED)
    return stamp, ticks


def _echo_numbers(data: bytes, message: int, layout: struct.Struct) -> tuple[int, ...]:
    payload = payload_of(data, message)
    if len(payload) < layout.size:
        raise WireError(f"got a NatNet echo message of {len(payload)} bytes, expected {layout.size}")
    return layout.unpack_from(payload)
