"""Output channels of foxglove-sdk: they are created from the table of topics and limit the rate of messages."""

from __future__ import annotations

from typing import Any, Protocol

from foxglove import Channel, Context, Schema
from foxglove.channels import FrameTransformChannel, LogChannel, PoseInFrameChannel, SceneUpdateChannel

from arena.recorder.viewer_poses import nanoseconds
from arena.wire.viewer_messages import (
    ENCODING,
    FAULT_NAME,
    FAULT_SCHEMA,
    SCHEMA_ENCODING,
    STATE_NAME,
    STATE_SCHEMA,
)
from arena.wire.viewer_topics import ARENA_TOPICS, VEHICLE_TOPICS, Content, Topic, topic_name

_OF_FOXGLOVE: dict[str, Any] = {
    "foxglove.FrameTransform": FrameTransformChannel,
    "foxglove.Log": LogChannel,
    "foxglove.PoseInFrame": PoseInFrameChannel,
    "foxglove.SceneUpdate": SceneUpdateChannel,
}
_WITH_TEXTS = {STATE_NAME: STATE_SCHEMA, FAULT_NAME: FAULT_SCHEMA}
_EARLY_S = 1e-6  # simulation time advances in steps, which are not exact in binary


class Throttle:
    """Rate limit for the messages of one viewer channel.

    period_s: shortest mean time between two accepted messages [s]; 0: all are accepted.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def due(self, time_s: float) -> bool:
        """Return whether a message at this time [s] may be sent under the rate limit.

        A clock that steps back does not stop the messages.
        """
        if _EARLY_S < self._next_s - time_s <= self._period_s:
            return False
        began_again = abs(self._next_s - time_s) > self._period_s
        self._next_s = (time_s if began_again else self._next_s) + self._period_s
        return True


class _Channel(Protocol):
    def log(self, message: Any, /, *, log_time: int | None = None) -> None: ...


class Output:
    """Output channel with a rate limit. Sending never blocks.

    context: context of foxglove-sdk, whose recorder and server receive the messages.  vehicle: name; None for a topic of the arena.
    due: function that returns whether a message at this time [s] is to be sent.  log: function that sends a message.
    """

    def __init__(self, context: Context, content: Content, vehicle: str | None = None) -> None:
        topic = (ARENA_TOPICS if vehicle is None else VEHICLE_TOPICS)[content]
        name, rate_hz = topic_name(content, vehicle), topic.rate_hz
        self.due = Throttle(1.0 / rate_hz if rate_hz else 0.0).due
        self._pack = topic.numbers.pack if topic.numbers is not None else None
        self.log = _channel(context, name, topic).log

    def send(self, message: Any, time_s: float) -> None:
        """Send a message: bytes or a message of foxglove-sdk, as the topic requires.

        time_s: log time [s].
        """
        self.log(message, log_time=nanoseconds(time_s))

    def send_numbers(self, time_s: float, *values: float) -> None:
        """Send a message that consists of numbers only: the values of all its fields, in their order.

        time_s: log time [s].
        """
        if self._pack is None:
            raise TypeError(
                "send_numbers: the messages of this topic contain more than numbers: call send() instead"
            )
        self.log(self._pack(*values), log_time=nanoseconds(time_s))


def _channel(context: Context, name: str, topic: Topic) -> _Channel:
    """Create a channel of foxglove-sdk.

    name: topic of the channel.
    topic: its row of the table.
    """
    if topic.schema in _OF_FOXGLOVE:
        made: _Channel = _OF_FOXGLOVE[topic.schema](name, context=context)
        return made
    text = topic.numbers.schema if topic.numbers is not None else _WITH_TEXTS[topic.schema]
    schema = Schema(name=topic.schema, encoding=SCHEMA_ENCODING, data=text.encode())
    return Channel(name, message_encoding=ENCODING, schema=schema, context=context).base
