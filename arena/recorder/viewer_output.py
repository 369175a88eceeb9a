"""Output channels for viewers. The table of topics says which channels there are, and their highest rate."""

from __future__ import annotations

from typing import Any

from foxglove.messages import FrameTransform, Log, PoseInFrame, SceneUpdate

from arena.kernels.viewer_meters import Throttle, nanoseconds
from arena.kernels.viewer_telemetry import NumberOutput
from arena.recorder.mcap_file import MakeChannel
from arena.recorder.mcap_records import SchemaData
from arena.wire.flight_record import MessageSchema
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
    f"foxglove.{message.__name__}": message for message in (FrameTransform, Log, PoseInFrame, SceneUpdate)
}
_WITH_TEXTS = {STATE_NAME: STATE_SCHEMA, FAULT_NAME: FAULT_SCHEMA}


class Output:
    """Output channel with a rate limit. Sending never blocks.

    channel: creates a channel in the record.  vehicle: name; None for a topic of the arena.
    limit: limit of the rate.  log: function that sends a message.  numbers: output of messages of numbers, None for other topics.
    """

    def __init__(self, channel: MakeChannel, content: Content, vehicle: str | None = None) -> None:
        topic = (ARENA_TOPICS if vehicle is None else VEHICLE_TOPICS)[content]
        name, rate_hz = topic_name(content, vehicle), topic.rate_hz
        self.limit = Throttle(1.0 / rate_hz if rate_hz else 0.0)
        self.log = channel(name, *_encoding(topic))
        self.numbers = (
            None if topic.numbers is None else NumberOutput(self.limit, self.log, len(topic.numbers.fields))
        )

    def send(self, message: bytes, time_s: float) -> None:
        """Send an encoded message. time_s: its log time [s]."""
        self.log(message, nanoseconds(time_s))

    def send_numbers(self, time_s: float, *values: float) -> None:
        """Send a message that consists of numbers only: the values of all its fields, in their order.

        time_s: log time [s].
        """
        if self.numbers is None:
            raise TypeError(
                "send_numbers: the messages of this topic contain more than numbers: call send() instead"
            )
        self.send(self.numbers.messages.pack(values), time_s)


def _encoding(topic: Topic) -> tuple[str, SchemaData]:
    """Return the encoding of the messages of a topic, and their schema."""
    if topic.schema in _OF_FOXGLOVE:
        schema: SchemaData = _OF_FOXGLOVE[topic.schema].get_schema()
        return schema.encoding, schema
    text = topic.numbers.schema if topic.numbers is not None else _WITH_TEXTS[topic.schema]
    return ENCODING, MessageSchema(name=topic.schema, encoding=SCHEMA_ENCODING, text=text)
