"""Direct MAVLink connection from `land-all` to a real vehicle.

While the vehicle's link process `link.<v>` works, the direct connection is used in addition to it. If the
link process has ended or no longer reads its socket, the direct connection replaces it. A link process that
still reads is never killed: in this case the vehicle itself is silent, and the link process receives its
telemetry as soon as the vehicle sends again.
A link process that the supervisor restarts gets its port or device back.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator

from arena.emergency.direct_signing import DirectSigning
from arena.emergency.identity_check import IdentityCheck
from arena.emergency.link_process import kill, unread_bytes
from arena.emergency.link_restart import LinkRestart
from arena.emergency.run_record import DirectAddress, recorded_process
from arena.transport import MAX_DATAGRAMS_PER_READ, Address, SerialPort, Source, open_udp, receive_datagrams
from arena.wire.mavlink_frame import AUTOPILOT, Stream, parse_frames

BESIDE_AFTER_S = 0.5  # without telemetry: send directly too
REPLACE_AFTER_S = 1.0  # without telemetry, and with unread datagrams at the link process: replace it
_CHECK_S, _RETRY_S = 0.1, 0.5


class DirectLink:
    """Direct connection to one real vehicle, used while its process `link.<vehicle>` does not work.

    The link process `link.<v>` is the process that normally owns the connection to the vehicle.

    Call `step` and `send` in every cycle of the loop, and `read` when one of `files` is readable.
    address: address of the vehicle
    system: MAVLink id of the vehicle
    component: MAVLink component id of this process
    link_address: UDP address on which the link process receives the commands of land-all
    say: function that prints a line for the user
    """

    def __init__(
        self,
        address: DirectAddress,
        *,
        name: str,
        system: int,
        component: int,
        link_address: Address,
        say: Callable[[str], None],
    ) -> None:
        self._address, self._name, self._system = address, name, system
        self._link_address, self._say = link_address, say
        self._vehicle = address.vehicle
        self._beside: socket.socket | None = None  # another port than the link's
        self._replacement: socket.socket | SerialPort | None = None  # the link's own port or device
        self._stream = Stream()
        self._restart = LinkRestart(self._process_name, address.run)
        self._unsent: list[bytes] = []  # the last frames, while the identity of the vehicle is not known
        self._unread_since: float | None = None
        self._next_check = self._next_try = 0.0
        self._printed: set[str] = set()
        recorded = address.connection.device or address.vehicle
        self._signing: DirectSigning | None = None
        self._identity: IdentityCheck | None = None
        if address.uid:
            self._identity = IdentityCheck(
                system=system, component=component, uid=address.uid, recorded=recorded, say=self._print
            )

    def step(self, silent_s: float, now: float, *, needed: bool = True) -> None:
        """Check the link process, and open a direct connection if the link process does not work.

        The link process does not work if it does not run, hangs, or passes on no telemetry. The direct
        connection is closed when the link process has been restarted.

        silent_s: time since the vehicle's last telemetry, or since the start [s].
        needed: False if the vehicle is confirmed, so that no connection has to be opened
        """
        if now < self._next_check:
            return
        self._next_check = now + _CHECK_S
        unread = unread_bytes(self._link_address)
        if self._replacement is not None:
            if unread is not None or self._restart.has_restarted():
                self._release()
            return
        if not needed:
            return
        if unread is None:
            self._on_no_link(now)
            return
        self._restart.on_link()
        self._check_reading(unread, silent_s, now)

    def send(self, frames: list[bytes], now: float) -> None:
        """Send frames to the vehicle on the open direct connections.

        Errors are ignored, because every command is sent again.
        """
        if self._replacement is None and self._beside is None:
            return
        if self._identity is None:
            receivers: list[Source] = [] if self._vehicle is None else [self._vehicle]
            receivers = [self._address.connection.device] if self._is_serial else receivers
        else:
            receivers = self._identity.receivers(now)
            for source, request in self._identity.requests(now):
                self._write(request, source)
        if not receivers:
            self._unsent = frames or self._unsent
            return
        for frame in (*self._unsent, *frames):
            for source in receivers:
                self._write(frame, source)
        self._unsent = []

    def files(self) -> list[int]:
        """Return the file descriptors of the direct connection, to wait for data."""
        return [file.fileno() for file in (self._replacement, self._beside) if file is not None]

    def read(self, fd: int, now: float) -> Iterator[bytes]:
        """Read data of the vehicle from one file descriptor. Yield complete MAVLink frames.

        now: monotonic [s].
        """
        for file in (self._replacement, self._beside):
            if file is None or file.fileno() != fd:
                continue
            if isinstance(file, SerialPort):
                yield from self._read_device(file, now)
            else:
                yield from self._read_socket(file, now)
            return

    def close(self) -> None:
        for file in (self._replacement, self._beside):
            if file is not None:
                file.close()

    @property
    def _process_name(self) -> str:
        return f"link.{self._name}"

    @property
    def _is_serial(self) -> bool:
        return self._address.connection.kind == "serial"

    def _on_no_link(self, now: float) -> None:
        """Open a direct connection, because the link process does not run.

        While the supervisor may restart the link process, a separate socket is used, so that the port stays free for it.
        If no restart is expected, the port of the link process is opened.
        """
        if self._restart.is_expected(now):
            self._print(f"{self._process_name} is not running; waiting for its restart")
            self._open_beside()
        else:
            self._replace_link(now, f"{self._process_name} is not running")

    def _check_reading(self, unread: int, silent_s: float, now: float) -> None:
        if not unread:
            self._unread_since = None
        elif self._unread_since is None:
            self._unread_since = now
        if silent_s >= BESIDE_AFTER_S and self._open_beside() and self._vehicle is not None:
            self._print(f"no telemetry; also sending directly to {self._vehicle[0]}:{self._vehicle[1]}")
        hangs = self._unread_since is not None and now - self._unread_since >= REPLACE_AFTER_S
        if hangs and silent_s >= REPLACE_AFTER_S:
            self._kill_link(now)

    def _open_beside(self) -> bool:
        """Open a UDP socket to the vehicle, besides that of the link process. Return False if the vehicle's address is unknown.

        The kernel chooses the port, so that the link process can still bind its own port.
        """
        if self._beside is None and self._vehicle is not None and not self._is_serial:
            self._beside = open_udp(("0.0.0.0", 0))
            self._on_opened()
        return self._beside is not None

    def _kill_link(self, now: float) -> None:
        process = self._address.link_process
        if self._address.run is not None:  # the supervisor may have restarted it since
            process = recorded_process(self._process_name, self._address.run) or process
        if process is None:
            self._print(
                f"{self._process_name} does not respond and its process id is unknown: name the run folder with --run"
            )
        elif kill(process):
            what = f"{self._process_name} (process {process.pid})"
            self._replace_link(now, f"{what} did not read for {REPLACE_AFTER_S:g} s and was killed")
        else:
            self._print(f"{self._process_name} (process {process.pid}) does not respond and cannot be killed")

    def _replace_link(self, now: float, why: str) -> None:
        """Open the UDP port or serial device of the link process, to send commands on it.

        Another call opens the port or device later if another process still uses it.
        """
        if now < self._next_try:
            return
        self._next_try = now + _RETRY_S
        connection = self._address.connection
        try:
            if connection.kind == "serial":
                self._replacement = SerialPort(connection.device, connection.baud)
            else:
                self._replacement = open_udp(self._address.local or ("0.0.0.0", 0))
        except OSError as error:
            self._print(f"{why}, but {connection} cannot be opened: {error.strerror or error}")
            self._open_beside()
            return
        self._stream = Stream()
        self._restart.on_replaced()
        self._unread_since = None
        self._print(f"{why}; sending on {connection} instead")
        self._on_opened()

    def _release(self) -> None:
        """Close the UDP port or serial device, so that the restarted link process can open it.

        This object had opened the port or device because the link process did not work.
        """
        if self._replacement is not None:
            self._replacement.close()
        self._replacement = None
        self._restart.on_link()
        self._printed.clear()
        self._print(f"{self._process_name} runs again; {self._address.connection} is released for it")

    def _on_opened(self) -> None:
        """Load the signing key of the vehicle for the direct connection.

        Warn if no hardware uid is recorded, because the identity of the vehicle cannot be checked then.
        """
        if self._address.key_file and self._signing is None:
            self._signing = DirectSigning(self._address.key_file, self._print)
        if self._identity is None:
            self._print("its hardware uid is not recorded: the identity of the vehicle is not checked")

    def _write(self, frame: bytes, to: Source) -> None:
        if self._signing is not None:
            frame = self._signing.sign(frame)
        with contextlib.suppress(OSError):
            if isinstance(self._replacement, SerialPort):
                self._replacement.write(frame)
            elif (sock := self._replacement or self._beside) is not None and isinstance(to, tuple):
                sock.sendto(frame, to)

    def _read_socket(self, sock: socket.socket, now: float) -> Iterator[bytes]:
        for received, sender in receive_datagrams(sock):
            data = received if self._signing is None else self._signing.accepted(received)
            if not data:
                continue
            if self._identity is not None:
                if self._identity.receive(data, sender, now):
                    yield data
            elif sender == self._vehicle or self._is_vehicle(data, sender):
                yield data

    def _is_vehicle(self, data: bytes, sender: Address) -> bool:
        """Return whether a datagram from an unknown address was sent by the vehicle.

        The datagram must contain a frame of the vehicle's autopilot. If an address of the vehicle is known, the sender must
        have the same IP address. Used only if no hardware uid is recorded.
        """
        if self._vehicle is not None and sender[0] != self._vehicle[0]:
            return False
        matches = any(f.sysid == self._system and f.compid == AUTOPILOT for f in parse_frames(data).frames)
        if matches and self._address.connection.kind == "udpin":
            self._vehicle = sender
        return matches

    def _read_device(self, port: SerialPort, now: float) -> Iterator[bytes]:
        device = self._address.connection.device
        for _ in range(MAX_DATAGRAMS_PER_READ):
            try:
                data = port.read()
            except OSError:  # unplugged: opened again when it is back
                port.close()
                self._replacement = None
                if self._identity is not None:
                    self._identity.forget(device)
                return
            if data is None:
                return
            buffer, found = self._stream.feed(data)
            for frame in found.frames:
                one = buffer[frame.start : frame.end]
                one = one if self._signing is None else self._signing.accepted(one)
                if one and (self._identity is None or self._identity.receive(one, device, now)):
                    yield one

    def _print(self, text: str) -> None:
        """Print a line for the user, unless the same line was printed before."""
        if text not in self._printed:
            self._printed.add(text)
            self._say(f"{self._name}: {text}")
