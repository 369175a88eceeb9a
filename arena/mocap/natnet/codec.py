"""Codec for NatNet 3.0 to 4.2, the network protocol of OptiTrack's Motive. No sockets, no axis conversions.

Every packet has a message number u16, a payload size u16 and the payload; all little endian. From 4.1 on the
count of each section is followed by the section's size in bytes. Positions are in metres and quaternions in
xyzw, in the axes of the capture system. Later 4.x versions are decoded too, if their frames have the layout
of 4.2. (Layouts follow the documentation of the NatNet SDK and its public clients.)
"""

from __future__ import annotations

import struct
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from arena.errors import WireError
from arena.kernels import natnet_payload
from arena.kernels.natnet_bodies import BodyEncoder
from arena.kernels.natnet_payload import PayloadReader, payload_of

if TYPE_CHECKING:
    from arena.kernels.natnet_bodies import BodyFields

CONNECT, SERVERINFO, REQUEST, RESPONSE, REQUEST_MODELDEF, MODELDEF = 0, 1, 2, 3, 4, 5
REQUEST_FRAME, FRAME, MESSAGE, DISCONNECT, KEEPALIVE, UNRECOGNIZED = 6, 7, 8, 9, 10, 100
ECHO_REQUEST, ECHO_RESPONSE = 12, 13
TRACKING_VALID = 1  # bit of a body's parameters
MODELS_CHANGED = 2  # bit of a frame's parameters

Version = tuple[int, int]
_HEAD = struct.Struct("<HH")
_COUNT = struct.Struct("<i")
_SIZED = struct.Struct("<ii")
_STAMPS = struct.Struct(
    "<IIdQQQ"
)  # time code and its part, time stamp, then ticks at exposure, at reception, at transmission
_NAME_BYTES = 256
_NEWEST_KNOWN, _TOO_NEW = (4, 2), (5, 0)


class Body(NamedTuple):
    """Pose of a rigid body in a NatNet FRAME packet.

    position: [m] [capture axes]. quat_xyzw: attitude [-] [capture axes]. mean_error_m: NatNet's mean marker error [m].
    tracked: NatNet's tracking-valid bit.
    """

    streaming_id: int
    position: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float]
    mean_error_m: float = 0.0
    tracked: bool = True


class Frame(NamedTuple):
    """Content of a NatNet FRAME packet: the poses of rigid bodies at one exposure, with time stamps.

    number: frame number. timestamp_s: the server's time [s].
    exposure_ticks, transmit_ticks: times of the middle of the exposure and of sending, in ticks of the
    server's clock. None: sent at the time of the exposure.
    models_changed: the server's list of bodies has changed since its last MODELDEF.
    """

    number: int
    timestamp_s: float
    exposure_ticks: int
    bodies: tuple[Body, ...]
    transmit_ticks: int | None = None
    models_changed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerInfo:
    """Content of a NatNet SERVERINFO packet: name, version, clock rate and data port of a server.

    group: multicast group; "" if the server streams by unicast.
    """

    name: str
    app_version: tuple[int, int, int, int]
    version: Version
    clock_hz: int
    data_port: int
    group: str


def is_supported(version: Version) -> bool:
    """Return whether this module can decode frames of a NatNet version: 3.0, 3.1 or any 4.x."""
    return version in ((3, 0), (3, 1)) or (4, 0) <= version < _TOO_NEW


def has_known_layout(version: Version) -> bool:
    """Return whether the layout of a version's frames is known. For a later version the length of each frame is checked."""
    return version <= _NEWEST_KNOWN


def packet(message: int, payload: bytes = b"") -> bytes:
    """Return a NatNet packet with this message number and payload."""
    return _HEAD.pack(message, len(payload)) + payload


def message_of(data: bytes) -> int:
    """Return the message number of a NatNet packet.

    Raises WireError if the packet is shorter than the size in its header.
    """
    return natnet_payload.message_of(data)


# -- server information ----------------------------------------------------------------------------------------------------


def encode_server_info(info: ServerInfo) -> bytes:
    """Encode a NatNet SERVERINFO packet."""
    name = info.name.encode()[: _NAME_BYTES - 1].ljust(_NAME_BYTES, b"\0")
    group = bytes(int(x) for x in info.group.split(".")) if info.group else bytes(4)
    tail = struct.pack("<QHB", info.clock_hz, info.data_port, 1 if info.group else 0) + group
    return packet(SERVERINFO, name + bytes(info.app_version) + bytes((*info.version, 0, 0)) + tail)


def decode_server_info(data: bytes) -> ServerInfo:
    """Decode a NatNet SERVERINFO packet. Raises WireError for an invalid packet."""
    payload = payload_of(data, SERVERINFO)
    if len(payload) < _NAME_BYTES + 8:
        raise WireError(
            f"got a NatNet SERVERINFO packet of {len(payload)} bytes, expected {_NAME_BYTES + 8} or more"
        )
    app, version = payload[_NAME_BYTES : _NAME_BYTES + 4], payload[_NAME_BYTES + 4 : _NAME_BYTES + 8]
    clock, port, multicast, group = 0, 0, 0, bytes(4)
    if len(payload) >= _NAME_BYTES + 8 + 15:
        clock, port, multicast = struct.unpack_from("<QHB", payload, _NAME_BYTES + 8)
        group = payload[_NAME_BYTES + 19 : _NAME_BYTES + 23]
    return ServerInfo(
        name=payload[:_NAME_BYTES].split(b"\0")[0].decode(errors="replace"),
        app_version=(app[0], app[1], app[2], app[3]),
        version=(version[0], version[1]),
        clock_hz=clock,
        data_port=port,
        group=".".join(map(str, group)) if multicast else "",
    )


# -- model definitions -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyModel:
    """Description of a rigid body in a NatNet MODELDEF packet."""

    name: str
    definition: bytes  # all bytes after the name; they change if a user defines the body again
    markers: int


def encode_models(
    bodies: Sequence[tuple[int, str]],
    version: Version,
    markers: Sequence[tuple[float, float, float]] = (),
) -> bytes:
    """Encode a NatNet MODELDEF packet, which describes the rigid bodies of a server.

    bodies: (streaming id, name) of each body. markers: marker positions, the same for every body [m] [body axes].
    """
    out = [_COUNT.pack(len(bodies))]
    for streaming_id, name in bodies:
        description = name.encode() + b"\0" + struct.pack("<ii3f", streaming_id, -1, 0.0, 0.0, 0.0)
        if version >= (4, 2):
            description += struct.pack("<4f", 0.0, 0.0, 0.0, 1.0)
        description += _COUNT.pack(len(markers)) + b"".join(struct.pack("<3f", *m) for m in markers)
        description += bytes((5 if version >= (4, 0) else 4) * len(markers))  # labels, and empty names
        out.append(_COUNT.pack(1))
        if version >= (4, 1):
            out.append(_COUNT.pack(len(description)))
        out.append(description)
    return packet(MODELDEF, b"".join(out))


def decode_models(data: bytes, version: Version) -> list[tuple[int, BodyModel]]:
    """Decode a NatNet MODELDEF packet. Return (streaming id, description) of each rigid body.

    Several bodies can have the same streaming id.

    Raises WireError for an invalid packet. From 4.1 on, descriptions other than rigid bodies are skipped.
    Older versions can be decoded only if nothing but marker sets precedes the rigid bodies.
    """
    reader = PayloadReader(payload_of(data, MODELDEF))
    found: list[tuple[int, BodyModel]] = []
    for _ in range(reader.count("descriptions")):
        kind = reader.i32()
        if version >= (4, 1):
            part = PayloadReader(reader.section())
            if kind == 1:
                name, begin = part.text(), part.at
                streaming_id, markers = part.i32(), 0
                if len(part.data) >= (at := part.at + 16 + (16 if version >= (4, 2) else 0)) + 4:
                    (markers,) = _COUNT.unpack_from(part.data, at)
                model = BodyModel(name=name, definition=part.data[begin:], markers=markers)
                found.append((streaming_id, model))
        elif kind == 0:
            reader.text()
            for _ in range(reader.count("markers")):
                reader.text()
        elif kind == 1:
            name, begin = reader.text(), reader.at
            streaming_id = reader.i32()
            reader.skip(16)
            markers = _skip_marker_descriptions(reader, version)
            definition = reader.data[begin : reader.at]
            found.append((streaming_id, BodyModel(name=name, definition=definition, markers=markers)))
        else:
            break
    return found


def _skip_marker_descriptions(reader: PayloadReader, version: Version) -> int:
    """Skip the marker descriptions of a rigid body, and return the number of markers."""
    markers = reader.count("markers")
    reader.skip(16 * markers)
    if version >= (4, 0):
        for _ in range(markers):
            reader.text()
    return markers


# -- frames of data --------------------------------------------------------------------------------------------------------


class FrameEncoder:
    """Encoder of the FRAME packets of one NatNet version."""

    def __init__(self, version: Version) -> None:
        self._sized = version >= (4, 1)
        empty = _SIZED.pack(0, 0) if self._sized else _COUNT.pack(0)
        # marker sets, loose markers | rigid bodies | skeletons, (4.1: assets), labelled markers, force plates, devices
        self._before, self._after = empty * 2, empty * (5 if self._sized else 4)
        # 4.1: a precision time stamp of 8 bytes, which this server does not have
        self._tail = struct.Struct(f"{_STAMPS.format}{'8x' if self._sized else ''}hi")
        self._bodies = BodyEncoder(TRACKING_VALID)

    def encode(
        self,
        number: int,
        timestamp_s: float,
        exposure_ticks: int,
        transmit_ticks: int,
        bodies: Sequence[BodyFields],
        *,
        models_changed: bool = False,
    ) -> bytes:
        """Encode a frame. The arguments are those of `Frame`."""
        encoded = self._bodies.encode(bodies)
        head = _SIZED.pack(len(bodies), len(encoded)) if self._sized else _COUNT.pack(len(bodies))
        flags = MODELS_CHANGED if models_changed else 0
        tail = self._tail.pack(0, 0, timestamp_s, exposure_ticks, transmit_ticks, transmit_ticks, flags, 0)
        return packet(FRAME, _COUNT.pack(number) + self._before + head + encoded + self._after + tail)


def encode_frame(frame: Frame, version: Version) -> bytes:
    """Encode a NatNet FRAME packet."""
    sent = frame.exposure_ticks if frame.transmit_ticks is None else frame.transmit_ticks
    return FrameEncoder(version).encode(
        frame.number,
        frame.timestamp_s,
        frame.exposure_ticks,
        sent,
        frame.bodies,
        models_changed=frame.models_changed,
    )


def decode_frame(data: bytes, version: Version, wanted: Container[int] | None = None) -> Frame:
    """Decode a NatNet FRAME packet. Raises WireError for an invalid packet.

    wanted: streaming ids of the bodies to decode; None decodes all bodies.
    """
    reader = PayloadReader(payload_of(data, FRAME))
    number, timestamp_s, exposure, transmit, params, bodies = reader.frame(
        wanted, version, has_known_layout(version)
    )
    return Frame(
        number=number,
        timestamp_s=timestamp_s,
        exposure_ticks=exposure,
        transmit_ticks=transmit,
        bodies=tuple(
            [
                Body(i, (x, y, z), (qx, qy, qz, qw), error, bool(params & TRACKING_VALID))
                for i, x, y, z, qx, qy, qz, qw, error, params in bodies
            ]
        ),
        models_changed=bool(params & MODELS_CHANGED),
    )
