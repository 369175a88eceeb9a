"""MAVLink ids of arena's own programs, and the largest id of a vehicle. Pure, standard library only.

A MAVLink sender has a system id and a component id. Two things depend on them:

- An autopilot addresses its replies (COMMAND_ACK, PARAM_ERROR) to the ids of the sender, and the router carries them there. Two
  programs with the same ids at one vehicle would each take the replies to the other one for their own. So each program has ids
  of its own, and programs of one kind that may run at the same time choose their component id by their process id.
- The system id gives a sender its role at a tools port and on the links of an autopilot (`arena.authority.command_gate`).
  So the programs of one role share a system id.

No vehicle has one of these system ids: the ids of vehicles end at `LARGEST_VEHICLE_ID`. A vehicle with such an id would have the
same id as a program, and its own program would get the role of that program.

An autopilot that signs its messages accepts at most 16 senders until its next start. After that it refuses further ones, also
`arena land-all`. At such a vehicle, each program has one component id that never changes (`signed`, or a range of one).

`SENDERS` and `VEHICLE_COMPONENTS` are the tables of docs/reference/mavlink-ids.md.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

LARGEST_VEHICLE_ID = 249
"""Largest MAVLink system id of a vehicle. PX4's own limit is 250."""


@dataclass(frozen=True, kw_only=True)
class Sender:
    """MAVLink system and component ids of one kind of program, such as the copilot or `arena params`.

    system: system id
    first, last: range of the component ids; more than one: each process has its own
    signed: component id at vehicles that sign their messages; None: as at all others
    program: the program, for the reference page
    purpose: what it sends, and why it needs these ids
    """

    system: int
    first: int
    last: int
    signed: int | None = None
    program: str
    purpose: str

    @property
    def component(self) -> int:
        """Component id of this process. Two processes that run at the same time usually have different ids."""
        return self.first + os.getpid() % (self.last - self.first + 1)

    @property
    def components(self) -> frozenset[int]:
        """All component ids that a program of this kind can have."""
        return frozenset(range(self.first, self.last + 1)) | ({self.signed} if self.signed else set())

    def component_at(self, *, signs: bool) -> int:
        """Return the component id with which this process sends to a vehicle.

        signs: whether the vehicle signs its messages.
        """
        return self.signed if signs and self.signed is not None else self.component


HOLD = Sender(
    system=250,
    first=30,
    last=59,
    signed=120,
    program="button HOLD of `arena monitor`",
    purpose="commands AUTO.LOITER as a ground station",
)
PILOT = Sender(
    system=250,
    first=60,
    last=60,  # one person flies a vehicle: `arena.fly.running_vehicle.lock_pilot`
    program="`arena fly` by hand",
    purpose="sends sticks and modes as a ground station",
)
FLIGHT_TOOL = Sender(
    system=250,
    first=90,
    last=90,
    program="`arena fly`, `arena shell`: parameters of the vehicle",
    purpose="reads parameters only. Two of these programs at one vehicle may receive the replies to each other",
)
REFEREE = Sender(
    system=250,
    first=190,
    last=249,
    program="referee of `arena smoke`",
    purpose="requests messages, and sends the commands of a scenario, as a ground station",
)
COPILOT = Sender(
    system=251,
    first=190,
    last=190,
    program="process `copilot`",
    purpose="commands hold or landing; its system id gives it the role copilot",
)
LOG_DOWNLOAD = Sender(
    system=252,
    first=30,
    last=89,
    signed=189,
    program="`arena log download`",
    purpose="requests log files",
)
KEY_EXCHANGE = Sender(
    system=252,
    first=188,
    last=188,
    program="`arena signing`",
    purpose="gives a signing key to an autopilot over a cable",
)
ROS2_BRIDGE = Sender(
    system=252,
    first=191,
    last=191,
    program="process `ros2`",
    purpose="sends the setpoints and commands of ROS 2 programs, and publishes the replies to them",
)
PARAMETER_TOOL = Sender(
    system=252,
    first=192,
    last=249,
    signed=190,
    program="`arena params`",
    purpose="reads and writes parameters, and reboots autopilots",
)
EMERGENCY = Sender(
    system=253,
    first=191,
    last=249,
    signed=190,
    program="`arena land-all`, `arena kill-all`, the landing at the end of a run",
    purpose="lands vehicles and stops motors; the system id gives the role land-all",
)
ROUTER = Sender(
    system=254,
    first=190,
    last=190,
    program="process `router`",
    purpose="sends the heartbeat of a ground station; a PING to these ids registers a viewer",
)
VIEWER = Sender(
    system=255,
    first=25,
    last=84,
    program="viewers: `arena top`, `arena monitor`, and others",
    purpose="send PING to the router, which forwards it to nobody",
)
SENSORS_PING = Sender(
    system=255,
    first=85,
    last=85,
    program="process `sensors`, to receive telemetry",
    purpose="sends PING to the router; measurements have the ids of the vehicle",
)
PILOT_PING = Sender(
    system=255,
    first=86,
    last=86,
    program="`arena fly` by hand, before the first command",
    purpose="sends PING to the router, to receive telemetry before it counts as a ground station",
)
SENDERS: tuple[Sender, ...] = (
    HOLD,
    PILOT,
    FLIGHT_TOOL,
    REFEREE,
    COPILOT,
    LOG_DOWNLOAD,
    KEY_EXCHANGE,
    ROS2_BRIDGE,
    PARAMETER_TOOL,
    EMERGENCY,
    ROUTER,
    VIEWER,
    SENSORS_PING,
    PILOT_PING,
)
"""All programs of arena with ids of their own."""

GROUND_TOOLS_SYSTEM = HOLD.system
"""System id that gives a tool of arena the role of a ground station."""

SENSORS_COMPONENT = 158  # MAV_COMP_ID_PERIPHERAL
PROGRAM_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
LINK_COMPONENT = 192  # MAV_COMP_ID_ONBOARD_COMPUTER2
FORWARDER_COMPONENT = 197  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
VEHICLE_COMPONENTS: Mapping[int, tuple[str, str]] = {
    1: (
        "autopilot",
        "MAV_COMP_ID_AUTOPILOT1. Router and hardware link refuse commands with it, because the sender expects the autopilot's reply",
    ),
    SENSORS_COMPONENT: (
        "emulated sensors (process `sensors`)",
        "MAV_COMP_ID_PERIPHERAL. Only DEBUG_FLOAT_ARRAY",
    ),
    PROGRAM_COMPONENT: ("user program, on any backend", "MAV_COMP_ID_ONBOARD_COMPUTER"),
    LINK_COMPONENT: ("hardware link (process `link`)", "MAV_COMP_ID_ONBOARD_COMPUTER2"),
    FORWARDER_COMPONENT: ("pose forwarder (process `forward`)", "MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY"),
}
"""Component id -> sender and note, of those that have the system id of the vehicle."""
