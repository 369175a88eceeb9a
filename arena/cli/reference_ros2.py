"""Reference page of the ROS 2 topics that the bridge to ROS 2 publishes and subscribes to."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from arena.ros2.bridge import SETPOINTS
from arena.ros2.outgoing import TOPICS

Table = Callable[[Iterable[str], Iterable[Iterable[str]]], str]

_HEAD = """# ROS 2 topics

Topics of the bridge `tools: {ros2: true}`. [Use ROS 2](../howto/ros2.md) describes it.
Each vehicle has these topics in the namespace of its name, such as `/uav1/pose`.
`map` is the arena's world (ENU), `NAME/base_link` the body (FLU). Messages of `px4_msgs` are those of PX4 v1.16, in NED and FRD.

"""
_READ = """
## Read from ROS 2

With `setpoints: true`.

"""
_ONCE = """
## Topics of the arena

"""


def ros2_page(table: Table) -> str:
    """Return the page of all ROS 2 topics as Markdown.

    table: function that makes a table in Markdown.
    """
    head = ("topic", "message", "content")
    published = ((f"`{t.name}`", _full(t.message), t.meaning) for t in TOPICS)
    read = ((f"`{topic}`", _full(name), meaning) for topic, (name, meaning) in SETPOINTS.items())
    clock = [
        ("`/clock`", _full("rosgraph_msgs/Clock"), "simulation time; only in an arena without real vehicles")
    ]
    return (
        _HEAD
        + "## Published\n\n"
        + table(head, published)
        + _ONCE
        + table(head, clock)
        + _READ
        + table(head, read)
    )


def _full(name: str) -> str:
    return f"`{name.replace('/', '/msg/')}`"
