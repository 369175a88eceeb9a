"""Writes flights as a ROS 2 bag, or as one MCAP file with ROS 2 messages. Needs rosbags."""

from __future__ import annotations

import heapq
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from arena.errors import InputError, NotInstalledError
from arena.flight_log.flight import Flight
from arena.flight_log.ros2_messages import RosTopic, stamp_ns, topics_of

WITHOUT_ROSBAGS = (
    "ROS 2 bags need the package rosbags, which is not installed: pip install 'flying-arena[logs]'"
)
_BAG_VERSION: Literal[8] = 8  # of metadata.yaml: ROS 2 Humble and newer read it


def write_bag(folder: Path, flights: Sequence[Flight]) -> int:
    """Write flights to a ROS 2 bag (a folder with sqlite3 storage). Return the number of messages.

    `ros2 bag` of Humble and newer reads the bag.

    Raises InputError if the folder exists, NotInstalledError if rosbags is missing.
    """
    if folder.exists():
        raise InputError(
            f"{folder}: already exists, but a ROS 2 bag must be a new folder: delete it, or choose another folder with -o"
        )
    return _write(folder, flights, "SQLITE3")


def write_mcap(path: Path, flights: Sequence[Flight]) -> int:
    """Write flights to one MCAP file with ROS 2 messages. Return the number of messages.

    Foxglove and PlotJuggler open the file. An existing file is replaced.

    Raises NotInstalledError if rosbags is missing.
    """
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".mcap") as folder:
        count = _write(Path(folder) / "bag", flights, "MCAP")
        (written,) = (Path(folder) / "bag").glob("*.mcap")
        shutil.move(written, path)
    return count


def _write(folder: Path, flights: Sequence[Flight], storage: str) -> int:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise NotInstalledError(WITHOUT_ROSBAGS) from error

    store, count = get_typestore(Stores.ROS2_HUMBLE), 0
    with Writer(folder, version=_BAG_VERSION, storage_plugin=StoragePlugin[storage]) as writer:
        sources: list[Iterator[tuple[int, tuple[int, Any], Any]]] = []
        for flight in flights:
            for topic in topics_of(flight, store.types):
                connection = writer.add_connection(topic.name, topic.type, typestore=store)
                sources.append(_messages(flight, topic, (len(sources), connection)))
        for time_ns, (_, connection), message in heapq.merge(*sources, key=lambda m: (m[0], m[1][0])):
            writer.write(connection, time_ns, store.serialize_cdr(message, connection.msgtype))
            count += 1
    return count


def _messages(
    flight: Flight, topic: RosTopic, connection: tuple[int, Any]
) -> Iterator[tuple[int, tuple[int, Any], Any]]:
    """Yield (time [ns], connection, message) for each message of one ROS 2 topic.

    connection: (number, object) that the writer gave to the topic.
    """
    for row in topic.rows.tolist():
        yield stamp_ns(flight, row), connection, topic.make(row)
