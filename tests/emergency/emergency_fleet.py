"""Flying vehicles for land-all and kill-all, on the ports of an arena."""

from __future__ import annotations

from fake_autopilot import DENIED, LAND, SET_MODE, FakeAutopilot
from served import Connection, LossyLink, Served, UdpPort

from arena.emergency.targets import Target

REFUSES_LANDING = {SET_MODE: (DENIED, b""), LAND: (DENIED, b"")}


def target(k, host, name=""):
    base = 24000 + 10 * k
    return Target(
        name=name or f"uav{k}",
        id=k,
        autopilot=(host, base + 4),
        partner=(host, base + 5),
        tools=(host, base + 6),
    )


def flying(k, **changes):
    """Return a vehicle that flies in OFFBOARD, lands within 0.2 s of the command, and then disarms."""
    state = {"armed": True, "landed": False, "mode": "OFFBOARD", "land_s": 0.2, "period_s": 0.05}
    return FakeAutopilot(system=k, telemetry=("HEARTBEAT", "EXTENDED_SYS_STATE"), **(state | changes))


class Fleet(Served):
    """Vehicles on the ports of an arena.

    vehicles: system ids of flying vehicles, or autopilots
    paths: "panic" link, "tools" (in place of the router), "router" (link of a real router), "wire" (a real vehicle on UDP)
    loss: share of datagrams that are lost in each direction
    """

    def __init__(self, vehicles, host, paths=("panic", "tools"), loss=0.0):
        made = [v if isinstance(v, FakeAutopilot) else flying(v) for v in vehicles]
        self.autopilots = {autopilot.system: autopilot for autopilot in made}
        self.targets = [target(k, host) for k in self.autopilots]
        connections = []
        for t in self.targets:
            link = host, 24000 + 10 * t.id
            ways = {
                "panic": (t.autopilot, t.partner),
                "tools": (t.tools, None),
                "router": (link, (host, link[1] + 1)),
                "wire": ((host, 25000 + t.id), (host, 14540 + t.id)),
            }
            for local, remote in (ways[path] for path in paths):
                lossy = LossyLink(seed=len(connections), loss=loss)
                autopilot = self.autopilots[t.id]
                connections.append(
                    Connection(autopilot=autopilot, port=UdpPort(local), remote=remote, link=lossy)
                )
        super().__init__(connections)
