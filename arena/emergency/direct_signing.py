"""Message signing on the direct connection of `land-all` to a vehicle that has a signing key."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from arena.errors import InputError
from arena.wire.mavlink_frame import parse_frames

if TYPE_CHECKING:
    from arena.wire.mavlink_signing import SignedConnection


class DirectSigning:
    """Signs the commands of land-all to one vehicle, and refuses telemetry without a valid signature.

    If the key cannot be read, commands are sent without a signature, and all telemetry is used.
    key_file: file with the key
    say: function that prints a text for the user; it prints the same text only once
    wall: returns the time of the wall clock [s since 1970]
    """

    def __init__(
        self, key_file: str, say: Callable[[str], None], wall: Callable[[], float] = time.time
    ) -> None:
        # imported late: most vehicles have no key, and land-all must start fast
        from arena.signing_key import TimestampFile, read_key
        from arena.wire.mavlink_signing import LAND_ALL, SignedConnection

        self._say, self._wall = say, wall
        self._connection: SignedConnection | None = None
        try:
            key = read_key(key_file)
        except InputError as error:
            say(
                f"{error}. Commands on the direct connection are not signed: a vehicle that has a signing key ignores these commands"
            )
            return
        self._connection = SignedConnection(key, LAND_ALL, TimestampFile(key_file).first())

    def sign(self, frame: bytes) -> bytes:
        """Return a frame with a signature, or the unchanged frame if the vehicle has no signing key."""
        if self._connection is None:
            return frame
        return self._connection.sign(frame, self._wall()) or frame

    def accepted(self, data: bytes) -> bytes:
        """Return the frames of a datagram that have a valid signature.

        If the vehicle has no signing key, return all frames.
        """
        if self._connection is None:
            return data
        found = parse_frames(data).frames
        valid = self._connection.accepted(data, found, self._wall())
        if found and not valid:
            self._say("telemetry without a valid signature was received directly, and is not used")
        return b"".join(data[f.start : f.end] for f in valid)
