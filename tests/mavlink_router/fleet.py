"""A router's slice, a router with two vehicles, and the messages that they send, for the tests of this folder."""

from pymavlink.dialects.v20 import common as mavlink

from arena.mavlink_router.router import Router
from arena.mavlink_router.routing_table import Table

GCS = ("127.54.0.9", 14550)
RECORDER = ("127.54.0.2", 24002)
TOOL = ("127.0.0.1", 40001)
OFFBOARD, LAND = 6 << 16, 4 << 16 | 6 << 24


def slice_of(
    ids=(1, 2),
    host="127.54.0.1",
    base=24000,
    gcs=GCS,
    client_host=None,
    simulated=True,
    heartbeat=True,
    real=(),
    needs_operator=(),
    recorder=None,
    ground=(),
):
    client_host = client_host or host
    vehicles = [
        {
            "name": f"uav{k}",
            "id": k,
            **({"simulated": False} if k in real else {}),
            "needs_operator": k in needs_operator,
            "link": {"local": [host, base + 10 * k + 1], "remote": [client_host, base + 10 * k]},
            "ground": {"local": [host, 27001 + 2 * k], "remote": [client_host, 27000 + 2 * k]}
            if k in ground
            else None,
            "serve": [host, base + 10 * k + 8],
            "clients": [
                {"name": "program", "address": [client_host, 16000 + k]},
                {"name": "sdk", "address": [client_host, 22000 + k]},
            ],
            "tools": [host, base + 10 * k + 6],
        }
        for k in ids
    ]
    return {
        "name": "router",
        "vehicles": vehicles,
        "gcs_local": [host, base],
        "gcs": [{"name": "gcs", "address": list(gcs)}],
        "recorder": recorder and list(recorder),
        "heartbeat": heartbeat,
        "simulated": simulated,
    }


class Fleet:
    """A router with vehicles 1 and 2.

    Senders and receivers have names: "autopilot1", "program2", "gcs", "tool". "ground1" is the autopilot's end of the link
    for ground stations, which the vehicles in `ground` have.

    The results do not contain the recorder's copies of messages to vehicles.
    """

    def __init__(self, ids=(1, 2), real=(), needs_operator=(), ground=(), **router):
        self.table = Table.from_slice(
            slice_of(ids, real=real, needs_operator=needs_operator, recorder=RECORDER, ground=ground)
        )
        self.router = Router(self.table, **router)
        self.now = 100.0
        self.names = {GCS: "gcs", RECORDER: "recorder"}
        for v in self.table.vehicles:
            program, sdk = v.clients
            self.names |= {
                v.remote: f"autopilot{v.id}",
                program: f"program{v.id}",
                sdk: f"sdk{v.id}",
            }
            if v.ground is not None:
                self.names[v.ground.remote] = f"ground{v.id}"
        self.address = {name: address for address, name in self.names.items()}

    def socket(self, address):
        return self.router.sockets.index(address)

    def vehicle(self, k):
        return next(v for v in self.table.vehicles if v.id == k)

    def send_as(self, who, data, at=None):
        """Send a datagram from `who` to its usual socket, or to `at`; return {receiver: bytes}."""
        if who == "gcs":
            socket = self.table.gcs_local
        else:
            v = self.vehicle(int(who[-1]))
            socket = v.local if who.startswith("autopilot") else v.serve
            if who.startswith("ground"):
                socket = v.ground.local
        return self.send(self.address[who], at or socket, data)

    def tool(self, data, k=1, address=TOOL):
        self.names.setdefault(address, "tool")
        return self.send(address, self.vehicle(k).tools, data)

    def send(self, sender, socket, data):
        return self.named(self.router.on_datagram(self.socket(socket), sender, data, self.now))

    def named(self, out):
        """Return {receiver: bytes} of datagrams that the router sends."""
        tool_sockets = {self.socket(v.tools) for v in self.table.vehicles}
        received = {}
        for piece, destinations in out:
            for key, dest in destinations:
                if dest != RECORDER or key not in tool_sockets:
                    name = self.names[dest]
                    received[name] = received.get(name, b"") + bytes(piece)
        return received

    @property
    def dropped(self):
        return {why: n for why, n in self.router.counts.dropped.items() if n}


def sender_of(system, component=1):
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def packed(message, system, component=1):
    return bytes(message.pack(sender_of(system, component)))


def heartbeat(system=1, component=1, armed=False, mode=OFFBOARD, kind=2):
    return packed(mavlink.MAVLink_heartbeat_message(kind, 12, 1 | 128 * armed, mode, 4, 3), system, component)


def attitude(system=1, component=1):
    return packed(mavlink.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0, 0, 0.7), system, component)


def landed_state(state, system=1):
    return packed(mavlink.MAVLink_extended_sys_state_message(0, state), system)


def sys_status(battery, system=1, component=1, voltage_mv=12000):
    """Return SYS_STATUS. battery: remaining charge [%]; -1 if unknown."""
    message = mavlink.MAVLink_sys_status_message(0, 0, 0, 100, voltage_mv, 100, battery, 0, 0, 0, 0, 0, 0)
    return packed(message, system, component)


def command(target, sender, component=1):
    message = mavlink.MAVLink_command_long_message(target, component, 400, 0, 1, 0, 0, 0, 0, 0, 5)
    return packed(message, *sender)


def ack(target, system=1):
    return packed(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, *target), system)


def timesync(tc1, system=1, component=191):
    return packed(mavlink.MAVLink_timesync_message(tc1, 123456789), system, component)
