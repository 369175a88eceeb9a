"""Message signing of the link to a flight controller.

It has the key, the last timestamp, and the reason why received messages are ignored.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

from arena.fcu_link.settings import Settings
from arena.signing_key import TimestampFile, read_key
from arena.transport import Source
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, ParsedFrames, parse_frames
from arena.wire.mavlink_ids import LINK_COMPONENT
from arena.wire.mavlink_signing import LINK_PROCESS, SETUP_SIGNING, SignedConnection, Verdict

_HEARTBEAT_S = 1.0
_MOST_SOURCES = 8
_PROBLEMS = {
    Verdict.UNSIGNED: "its messages are not signed: it has no key. Run `arena signing setup`",
    Verdict.WRONG: "its messages have a wrong signature: it has another key than {file}",
    Verdict.OLD: "its messages have old timestamps: it has just started, or somebody repeats recorded messages",
}


class LinkSigning:
    """Signs every frame for the vehicle, and drops frames from the vehicle without a valid signature.

    Without a key file in the settings, it passes all frames unchanged. Raises InputError if the key cannot be read.
    A vehicle that has just started has an old timestamp until it receives a signed frame: `timestamp_heartbeats` returns one
    for each source whose frames are not validly signed.
    events: messages for the user; the caller takes them and empties the list
    problem: why the last messages of the vehicle were not used; "" if they were
    counts: receives the number of dropped frames, by reason
    wall: returns the time of the wall clock [s since 1970]
    """

    def __init__(
        self, settings: Settings, counts: Counter[str], wall: Callable[[], float] = time.time
    ) -> None:
        self.events: list[str] = []
        self.problem = ""
        self._system, self._file, self._counts, self._wall = settings.id, settings.key_file, counts, wall
        self._codec = Codec(settings.id, LINK_COMPONENT)
        self._connection: SignedConnection | None = None
        self._timestamps: TimestampFile | None = None
        self._was_valid, self._write_problem = False, ""
        self._heartbeat_at: dict[Source, float] = {}
        self._heartbeats_due: list[Source] = []
        if settings.key_file:
            self._timestamps = TimestampFile(settings.key_file)
            first, own = self._timestamps.first(), (settings.id, LINK_COMPONENT)
            self._connection = SignedConnection(read_key(settings.key_file), LINK_PROCESS, first, own=own)

    def accepted(self, source: Source, data: Buffer, found: ParsedFrames, now: float) -> ParsedFrames:
        """Return the received frames that have a valid signature; all frames if there is no key.

        now: monotonic [s].
        """
        if self._connection is None:
            return found
        before = self._connection.counts.copy()
        frames = self._connection.accepted(data, found.frames, self._wall())
        wrong = self._connection.counts - before
        del wrong[Verdict.VALID]
        for verdict, n in wrong.items():
            self._counts[f"from the vehicle: {verdict.value}"] += n
        if any(f.sysid == self._system and f.compid == AUTOPILOT for f in frames):
            self.problem = ""
            if not self._was_valid:
                self._was_valid = True
                self.events.append("its messages have a valid signature")
        elif any(f.sysid == self._system and f.compid == AUTOPILOT for f in found.frames):
            self.problem = _PROBLEMS[next(iter(wrong))].format(file=self._file)
            self._queue_heartbeat(source, now)
        return found._replace(frames=frames)

    def timestamp_heartbeats(self) -> list[tuple[Source, bytes]]:
        """Return heartbeats with the current signing timestamp, for autopilots without a valid signature.

        Each item is (receiver, heartbeat). A source gets at most one heartbeat a second.

        receiver: UDP address or serial device

        The caller signs each heartbeat and sends it to its source. A vehicle that has just restarted has an old signing
        timestamp, and takes the current one from this heartbeat.
        """
        sources, self._heartbeats_due = self._heartbeats_due, []
        return [(source, self._codec.onboard_heartbeat()) for source in sources]

    def signed(self, frame: bytes) -> bytes | None:
        """Sign a frame for the vehicle. Return None if the frame must not be sent.

        Without a key, the frame is returned unchanged. A SETUP_SIGNING must not be sent, and neither must a frame that cannot be
        signed (such as MAVLink 1). Both are counted.
        """
        if self._connection is None:
            return frame
        if any(f.msgid == SETUP_SIGNING for f in parse_frames(frame).frames):
            self._counts["to the vehicle: SETUP_SIGNING"] += 1  # it would contain a key as plain text
            return None
        signed = self._connection.sign(frame, self._wall())
        self._counts["to the vehicle: cannot be signed"] += signed is None
        return signed

    def next_frame(self, take: Callable[[float], bytes | None], now: float) -> bytes | None:
        """Return the next signed frame for the vehicle; None if there is none.

        take: returns the next frame that is not signed. Frames that cannot be signed are dropped.
        """
        while (frame := take(now)) is not None:
            if (signed := self.signed(frame)) is not None:
                return signed
        return None

    def tick(self, now: float) -> None:
        """Store the last signing timestamp in a file from time to time.

        A restarted link process then begins with a later timestamp.
        """
        if self._connection is None or self._timestamps is None:
            return
        self._timestamps.save(self._connection.timestamp, now)
        problem = self._timestamps.problem
        if problem and problem != self._write_problem:
            self.events.append(f"{problem}; the run continues")
        self._write_problem = problem

    def _queue_heartbeat(self, source: Source, now: float) -> None:
        if len(self._heartbeat_at) >= _MOST_SOURCES and source not in self._heartbeat_at:
            self._heartbeat_at.pop(min(self._heartbeat_at, key=lambda one: self._heartbeat_at[one]))
        if now - self._heartbeat_at.get(source, now - _HEARTBEAT_S) >= _HEARTBEAT_S:
            self._heartbeat_at[source] = now
            self._heartbeats_due.append(source)
