"""Output channels of foxglove-sdk: they are created from the table of topics and limit the rate of messages."""

from __future__ import annotations

from typing import Any, Protocol

from foxglove import Channel, Context, Schema
from foxglove.channels import LogChannel, SceneUpdateChannel
from foxglove.messages import FrameTransform, PoseInFrame

from arena.kernels.viewer_meters import Throttle, nanoseconds
from arena.kernels.viewer_telemetry import NumberOutput
from arena.wire.viewer_messages import (
    ENCODING,
    FAULT_NAME,
    FAULT_SCHEMA,
    SCHEMA_ENCODING,
    STATE_NAME,
    STATE_SCHEMA,
)
from arena.wire.viewer_topics import ARENA_TOPICS, VEHICLE_TOPICS, Content, Topic, topic_name

_OF_FOXGLOVE: dict[str, Any] = {"foxglove.Log": LogChannel, "foxglove.SceneUpdate": SceneUpdateChannel}
# The kernel `viewer_messages` encodes these messages, because they are frequent.
_ENCODED: dict[str, Any] = {"foxglove.FrameTransform": FrameTransform, "foxglove.PoseInFrame": PoseInFrame}
_WITH_TEXTS = {STATE_NAME: STATE_SCHEMA, FAULT_NAME: FAULT_SCHEMA}


class _Channel(Protocol):
    def log(self, message: Any, /, *, log_time: int | None = None) -> None: ...


class Output:
    """Output channel with a rate limit. Sending never blocks.

    context: context of foxglove-sdk, whose recorder and server receive the messages.  vehicle: name; None for a topic of the arena.
    limit: limit of the rate.  log: function that sends a message.  numbers: output of messages of numbers, None for other topics.
    """

    def __init__(self, context: Context, content: Content, vehicle: str | None = None) -> None:
        topic = (ARENA_TOPICS if vehicle is None else VEHICLE_TOPICS)[content]
        name, rate_hz = topic_name(content, vehicle), topic.rate_hz
        self.limit = Throttle(1.0 / rate_hz if rate_hz else 0.0)
        self.log = _channel(context, name, topic).log
        self.numbers = (
            None if topic.numbers is None else NumberOutput(self.limit, self.log, len(topic.numbers.fields))
        )

    def send(self, message: Any, time_s: float) -> None:
        """Send a message: bytes or a message of foxglove-sdk, as the topic requires.

        time_s: log time [s].
        """
        self.log(message, log_time=nanoseconds(time_s))

    def send_numbers(self, time_s: float, *values: float) -> None:
        """Send a message that consists of numbers only: the values of all its fields, in their order.

        time_s: log time [s].
        """
        if self.numbers is None:
            raise TypeError(
                "send_numbers: the messages of this topic contain more than numbers: call send() instead"
            )
        self.send(self.numbers.messages.pack(values), time_s)


def _channel(context: Context, name: str, topic: Topic) -> _Channel:
    """Create a channel of foxglove-sdk.

    name: topic of the channel.
    topic: its row of the table.
    """
    if topic.schema in _OF_FOXGLOVE:
        made: _Channel = _OF_FOXGLOVE[topic.schema](name, context=context)
        return made
    if topic.schema in _ENCODED:
        schema = _ENCODED[topic.schema].get_schema()
        return Channel(name, message_encoding=schema.encoding, schema=schema, context=context).base
    text = topic.numbers.schema if topic.numbers is not None else _WITH_TEXTS[topic.schema]
    schema = Schema(name=topic.schema, encoding=SCHEMA_ENCODING, data=text.encode())
    return Channel(name, message_encoding=ENCODING, schema=schema, context=context).base
