"""Reference page of the channels in `flight.mcap` and on the WebSocket for Foxglove."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from arena.wire import flight_record, viewer_messages
from arena.wire.viewer_topics import ARENA_TOPICS, VEHICLE_TOPICS, Content, Topic, topic_name

_VEHICLE = "VEHICLE"
_HEAD = """\
# Channels of a record

`flight.mcap` in the run folder is the record of a flight. It has two sets of channels. The raw channels contain all received data as they
were; arena's own tools read only these. The channels for viewers contain the same flight as messages that Foxglove and PlotJuggler show.
With `arena up --foxglove` all channels are also sent live. [Open a flight in Foxglove](../howto/foxglove.md) explains both.

`VEHICLE` is the name of a vehicle. Every log time is a time of one clock: simulation time, or Unix time if a vehicle is real.
"""
_RAW: Mapping[str, tuple[str, str]] = {
    flight_record.down_topic(_VEHICLE): (
        "none",
        "MAVLink datagrams from the vehicle, as the router passes them on; message encoding `mavlink`",
    ),
    flight_record.up_topic(_VEHICLE): (
        "none",
        "MAVLink datagrams to the vehicle, and references and planned paths that its program publishes; message encoding `mavlink`",
    ),
    flight_record.truth_topic(_VEHICLE): (
        f"`{flight_record.TRUE_STATE.name}`",
        "True states of a simulated vehicle, `log.rate_hz` per second",
    ),
    flight_record.FRAMES_TOPIC: (
        f"`{flight_record.CAPTURED_FRAME.name}`",
        "Each frame of the motion capture with all bodies",
    ),
    flight_record.EVENTS_TOPIC: (f"`{flight_record.EVENT.name}` (JSON)", "Each line of `events.jsonl`"),
}


def channels_page(table: Callable[[Iterable[str], Iterable[Iterable[str]]], str]) -> str:
    """Return the reference page of the channels as Markdown.

    table: function that makes a table in Markdown from its head and rows.
    """
    raw = ((f"`{topic}`", schema, content) for topic, (schema, content) in _RAW.items())
    return "\n".join(
        (
            _HEAD,
            "## Raw channels\n",
            table(("topic", "schema", "content"), raw),
            "## Channels for viewers\n",
            "A faster source is recorded at the rate of the table. Messages of Foxglove are Protobuf, all others ROS 2 messages (CDR).\n",
            table(("topic", "schema", "published", "content"), _topics()),
            "## Messages\n",
            *_messages(table),
        )
    )


def _topics() -> Iterator[tuple[str, ...]]:
    kinds: tuple[tuple[Mapping[Content, Topic], str | None], ...] = (
        (VEHICLE_TOPICS, _VEHICLE),
        (ARENA_TOPICS, None),
    )
    for topics, vehicle in kinds:
        for content, topic in topics.items():
            yield f"`{topic_name(content, vehicle)}`", f"`{topic.schema}`", topic.when, topic.what


def _messages(table: Callable[[Iterable[str], Iterable[Iterable[str]]], str]) -> Iterator[str]:
    """Yield Markdown text with the definition of each message type that arena defines."""
    shown = {
        topic.numbers.name: topic.numbers for topic in VEHICLE_TOPICS.values() if topic.numbers is not None
    }
    shown |= {
        topic.numbers.name: topic.numbers for topic in ARENA_TOPICS.values() if topic.numbers is not None
    }
    for name, message in shown.items():
        yield f"### {name}\n\n{message.summary}.\n"
        yield table(
            ("field", "meaning"), ((f"`{field}`", meaning) for field, meaning in message.fields.items())
        )
    for name, schema in (
        (viewer_messages.STATE_NAME, viewer_messages.STATE_SCHEMA),
        (viewer_messages.FAULT_NAME, viewer_messages.FAULT_SCHEMA),
        (flight_record.TRUE_STATE.name, flight_record.TRUE_STATE.text),
        (flight_record.CAPTURED_FRAME.name, flight_record.CAPTURED_FRAME.text),
    ):
        yield f"### {name}\n\n```text\n{schema}```\n"
