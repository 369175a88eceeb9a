"""Replies to the senders of requests that a preflight check refuses, and the texts for the user. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from arena.authority import TEMPORARILY_REJECTED, Kind, command_of, pack_reply, parse_request
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Buffer, Frame

_REPEAT_REASONS_S = 0.5  # a link gets the reasons of its refusals again after this time
_SAY_NEW_S = 1.0  # a program requests arming once a second
_SAY_AGAIN_S = 10.0
_NUMBER = re.compile(r"\d+(\.\d+)?")


class RefusalReplies:
    """Encoder of the replies to refused requests, in the name of the autopilot.

    codec: encoder with the ids of the vehicle's autopilot
    """

    def __init__(self, codec: Codec) -> None:
        self._codec, self._report = codec, _Report()
        self._reasons_sent_at: dict[str, float] = {}

    def text(self, data: Buffer, frame: Frame, reasons: Sequence[str], now: float) -> str:
        """Return the report of a refusal for the user; "" if it was shown a moment ago. now: monotonic time [s]."""
        what = _request_words(data, frame)
        text = f"{what} refused (requested by {frame.sysid}/{frame.compid}): {'; '.join(reasons)}"
        return text if self._report.is_due(text, now) else ""

    def reply(self, link: str, data: Buffer, frame: Frame, reasons: Sequence[str], now: float) -> bytes:
        """Encode the refusal of a request. Its sender may repeat the request.

        The reasons are sent to a link at most twice a second, the acknowledgement of a command always.

        link: link of the sender. reasons: most severe first.
        """
        fresh = now - self._reasons_sent_at.get(link, -math.inf) >= _REPEAT_REASONS_S
        if fresh:
            self._reasons_sent_at[link] = now
        sender = frame.sysid, frame.compid
        texts, command = reasons if fresh else (), command_of(data, frame)
        return pack_reply(self._codec, command, sender, texts, TEMPORARILY_REJECTED)


class _Report:
    """Decides when the user sees a refusal: at most one refusal per second, and the same refusal once in 10 s.

    Refusals that differ only in their numbers are the same.
    """

    def __init__(self) -> None:
        self._words, self._said_at = "", -math.inf

    def is_due(self, text: str, now: float) -> bool:
        """Return whether to show a refusal now. now: monotonic time [s]."""
        words = _NUMBER.sub("", text)
        if now - self._said_at < (_SAY_AGAIN_S if words == self._words else _SAY_NEW_S):
            return False
        self._words, self._said_at = words, now
        return True


def _request_words(data: Buffer, frame: Frame) -> str:
    """Return the request in a frame as text for the user, such as `arming` or `SERIAL_CONTROL`."""
    request = parse_request(data, frame)
    if request is not None and request.kind is Kind.ARM:
        return "arming"
    if command := command_of(data, frame):
        known = mavlink.enums["MAV_CMD"].get(command)
        return f"{known.name.removeprefix('MAV_CMD_')} (command {command})" if known else f"command {command}"
    name = mavlink.mavlink_map[frame.msgid].msgname
    return str(name)
