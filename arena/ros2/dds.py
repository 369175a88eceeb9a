"""DDS participant of the ROS 2 bridge, with writers and readers of topics (Eclipse Cyclone DDS).

Nothing here blocks: a sample that a reader does not accept at once is dropped and counted. A reader keeps only the newest samples.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any
from xml.sax.saxutils import quoteattr

from arena.errors import NotInstalledError
from arena.ros2.messages import Message, dds_topic, dds_type, fields

_MOST_SAMPLES = 16  # taken at once
CONFIGURATION_VARIABLE = "CYCLONEDDS_URI"
"""Environment variable of Cyclone DDS. If the user has set it, it replaces the bridge's own configuration."""


def configuration(address: str) -> str:
    """Return the Cyclone DDS configuration for one network interface.

    address: numeric address of the interface. On a loopback address participants are found by unicast on this computer, as
    ROS 2 nodes of every vendor listen there, too.
    """
    if address.startswith("127."):
        peers = '<Peers><Peer address="127.0.0.1"/></Peers>'
        network, found = '<NetworkInterface name="lo" multicast="true"/>', peers
    else:
        network, found = f"<NetworkInterface address={quoteattr(address)}/>", ""
    index = "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>64</MaxAutoParticipantIndex>"
    return (
        f"<CycloneDDS><Domain><General><Interfaces>{network}</Interfaces></General>"
        f"<Discovery>{index}{found}</Discovery></Domain></CycloneDDS>"
    )


@dataclass(frozen=True, kw_only=True)
class Sample:
    """Message that was received from a ROS 2 topic.

    age_s: time since its sender wrote the message, by the clocks of both computers [s].
    """

    message: Message
    age_s: float


class Participant:
    """DDS participant in one ROS 2 domain.

    domain: ROS_DOMAIN_ID. address: numeric address of the network interface.
    dropped: number of samples that could not be written at once.
    Raises NotInstalledError without the package cyclonedds.
    """

    def __init__(self, domain: int, address: str) -> None:
        try:
            from cyclonedds.core import DDSException
            from cyclonedds.domain import DomainParticipant
        except ImportError as error:
            raise NotInstalledError(
                "the package cyclonedds is missing: pip install 'flying-arena[ros2]'"
            ) from error
        os.environ.setdefault(CONFIGURATION_VARIABLE, configuration(address))
        self._participant = DomainParticipant(domain)
        self._error = DDSException
        self.dropped = 0

    def writer(self, topic: str, name: str, *, px4: bool = False) -> Callable[[Message], None]:
        """Return a function that publishes messages on a topic.

        topic: ROS name, such as `/uav1/pose`. name: message, such as `geometry_msgs/PoseStamped`.
        px4: PX4's quality of service (best effort, transient local) instead of ROS 2's default (reliable, volatile).
        """
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter

        reliability = (
            Policy.Reliability.BestEffort if px4 else Policy.Reliability.Reliable(max_blocking_time=0)
        )
        durability = Policy.Durability.TransientLocal if px4 else Policy.Durability.Volatile
        qos = Qos(reliability, durability, *_common(10 if not px4 else 1))
        made = DataWriter(self._participant, self._topic(topic, name), qos=qos)
        kind = type_of(name)

        def write(message: Message) -> None:
            try:
                made.write(_instance(kind, name, message))
            except self._error:
                self.dropped += 1

        return write

    def reader(self, topic: str, name: str, *, depth: int = 1) -> Callable[[], list[Sample]]:
        """Return a function that reads the messages of a topic that have arrived since its last call, oldest first.

        depth: of more messages than this, only the newest ones are returned.
        """
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader

        qos = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, *_common(depth))
        made = DataReader(self._participant, self._topic(topic, name), qos=qos)

        def take() -> list[Sample]:
            try:
                found = [each for each in made.take(N=_MOST_SAMPLES) if each.sample_info.valid_data]
            except self._error:
                return []
            found.sort(key=lambda each: each.sample_info.source_timestamp)  # of several senders
            now_ns = time.time_ns()
            return [
                Sample(
                    message=_mapping(name, each), age_s=(now_ns - each.sample_info.source_timestamp) * 1e-9
                )
                for each in found[-depth:]
            ]

        return take

    def _topic(self, topic: str, name: str) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, dds_topic(topic), type_of(name))


def _common(depth: int) -> tuple[Any, ...]:
    from cyclonedds.core import Policy

    return Policy.History.KeepLast(depth), Policy.DataRepresentation(use_cdrv0_representation=True)


@cache
def type_of(name: str) -> Any:
    """Return the Cyclone DDS class for a ROS 2 message type. The class is built from the fields of the type."""
    from cyclonedds.idl import IdlStruct, make_idl_struct

    found = {field: _idl(kind) for field, kind in fields()[name].items()}
    made: type[IdlStruct] = make_idl_struct(name.rpartition("/")[2] + "_", dds_type(name), found)
    return made


def _idl(kind: str) -> Any:
    from cyclonedds.idl import types

    base, _, size = kind.rstrip("]").partition("[")
    if kind.endswith("]"):
        return _array(types, _idl(base), int(size or 0))
    return type_of(base) if "/" in base else {"string": str, "bool": bool}.get(base) or getattr(types, base)


def _instance(kind: Any, name: str, message: Message) -> Any:
    known = fields()[name]
    return kind(
        **{
            field: _instance(type_of(known[field]), known[field], value) if "/" in known[field] else value
            for field, value in message.items()
        }
    )


def _mapping(name: str, instance: Any) -> dict[str, Any]:
    return {
        field: _mapping(kind, getattr(instance, field)) if "/" in kind else getattr(instance, field)
        for field, kind in fields()[name].items()
    }


def _array(types: Any, kind: Any, size: int) -> Any:
    """Return the DDS type of an array with a fixed size. Size 0 means a sequence of any length."""
    return types.array[kind, size] if size else types.sequence[kind]
