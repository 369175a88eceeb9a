"""NatNet server of the emulator: encodes measured frames and answers clients' requests."""

from __future__ import annotations

from collections import Counter

from arena.errors import WireError
from arena.mocap.emulator.interface import MeasuredFrame
from arena.mocap.emulator.udp_server import UdpServer
from arena.mocap.natnet import codec, echo
from arena.mocap.natnet.unicast_clients import UnicastClients
from arena.mocap.vendors import Settings
from arena.transport import Address

CLOCK_HZ = 10_000_000
_NEVER_ANSWERED = (codec.KEEPALIVE, codec.DISCONNECT)
_VERSIONS: dict[str, codec.Version] = {"3.1": (3, 1), "4.1": (4, 1)}


def open_server(settings: Settings) -> UdpServer:
    """Open the NatNet server of the emulator.

    settings: configuration of the `mocap` process.

    Raises RunError if the command port is taken.
    """
    server, requests = NatNetServer(settings), (settings["address"], int(settings["command_port"]))
    return UdpServer(server, requests, "NatNet", group=server.group)


class NatNetServer:
    """NatNet server without sockets, which implements the interface `ServerProtocol`.

    settings: configuration of the `mocap` process.
    group: multicast group and port to which frames are sent; None: by unicast to each client.
    """

    def __init__(self, settings: Settings) -> None:
        self.version = _VERSIONS[settings["version"]]
        self._encoder = codec.FrameEncoder(self.version)
        self.counts: Counter[str] = Counter()
        self._bodies = [(int(b["number"]), str(b["name"])) for b in settings["bodies"]]
        self._data_port = int(settings["data_port"])
        unicast = settings["transport"] == "unicast"
        self.group: Address | None = None if unicast else (settings["group"], self._data_port)
        self._clients = UnicastClients(self._data_port)
        self._now_s = 0.0

    def begin(self, sent_s: float) -> None:
        self._now_s = sent_s

    def encode(self, frame: MeasuredFrame, sent_s: float) -> bytes:
        exposed = round(frame.exposed_s * CLOCK_HZ)
        return self._encoder.encode(
            frame.number, frame.exposed_s, exposed, round(sent_s * CLOCK_HZ), frame.bodies
        )

    def destinations(self, wall: float) -> list[Address]:
        return [self.group] if self.group else self._clients.destinations(wall)

    def reply(self, data: bytes, sender: Address, wall: float) -> bytes | None:
        try:
            message = codec.message_of(data)
        except WireError:
            self.counts["malformed"] += 1
            return None
        self._clients.on_request(message, sender, wall)
        if message == codec.CONNECT:
            self.counts["connects"] += 1
            return self._server_info()
        if message == codec.REQUEST_MODELDEF:
            return codec.encode_models(self._bodies, self.version)
        if message == codec.ECHO_REQUEST:
            return self._echo(data)
        if message not in _NEVER_ANSWERED:
            self.counts["other message"] += 1
        return codec.packet(codec.UNRECOGNIZED) if message == codec.REQUEST else None

    def _echo(self, data: bytes) -> bytes | None:
        """Return the answer to an echo request, with the simulation time at which the last frame was sent.

        This is the present simulation time, because requests are answered directly after a frame is sent.
        During an injected delay it can be one frame older.
        """
        try:
            return echo.encode_echo_response(echo.decode_echo_request(data), round(self._now_s * CLOCK_HZ))
        except WireError:
            self.counts["malformed"] += 1
            return None

    def _server_info(self) -> bytes:
        return codec.encode_server_info(
            codec.ServerInfo(
                name="arena",
                app_version=(self.version[0], self.version[1], 0, 0),
                version=self.version,
                clock_hz=CLOCK_HZ,
                data_port=self._data_port,
                group=self.group[0] if self.group else "",
            )
        )
