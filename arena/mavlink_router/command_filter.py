"""Filter of the router that refuses commands of senders without authority over a vehicle.

A command is forwarded only if its sender may command the vehicle now (`arena.authority`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arena.authority import CommandGate, role_of_tool
from arena.mavlink_router.endpoints import Endpoint, Out
from arena.mavlink_router.routing_table import Vehicle
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import AUTOPILOT, Buffer, Frame


class CommandFilter:
    """Filter for the commands that clients of the router send to vehicles.

    It has one `CommandGate` per vehicle.

    sim_now: returns the simulation time [s], by which commands to simulated vehicles are timed; None without a
    simulated world.
    """

    def __init__(self, vehicles: Sequence[Vehicle], sim_now: Callable[[], float] | None = None) -> None:
        self._gates = {
            v.id: CommandGate(v.name, v.id, simulated=v.simulated, radio=v.radio) for v in vehicles
        }
        self._codecs = {v.id: Codec(v.id, AUTOPILOT) for v in vehicles}
        self._sim_now = sim_now
        self._replies: list[Out] = []
        self._news = set(self._gates)

    def allows(self, vehicle: int, endpoint: Endpoint, data: Buffer, frame: Frame, now: float) -> bool:
        """Return whether a MAVLink frame of a client, such as a command, may be sent to a vehicle now.

        vehicle: system id. now: monotonic [s].
        """
        gate = self._gates[vehicle]
        role = role_of_tool(frame[4]) if endpoint.role is None else endpoint.role
        if gate.simulated and self._sim_now is not None:
            now = self._sim_now()
        refusal = gate.refusal(role, data, frame, now, endpoint.address)
        if gate.has_news:
            self._news.add(vehicle)
        if refusal is None:
            return True
        if reply := refusal.reply(self._codecs[vehicle]):
            self._replies.append((reply, ((endpoint.socket, endpoint.address),)))
        return False

    def setpoint_test(self, vehicle: int) -> Callable[[float], bool]:
        """Return the function that decides whether a user program may send a setpoint to a vehicle now.

        The function gets the time (monotonic [s]). If it returns False, `allows` must decide.
        vehicle: system id.
        """
        gate, sim_now = self._gates[vehicle], self._sim_now
        passes = gate.authority.passes_program_setpoint
        return (lambda now: passes(sim_now())) if gate.simulated and sim_now is not None else passes

    def take_replies(self) -> list[Out]:
        """Return the replies to clients whose commands were refused since the last call."""
        if not self._replies:
            return []
        found, self._replies = self._replies, []
        return found

    def on_heartbeat(self, vehicle: int, armed: bool, mode: str, now: float) -> None:
        """Update the arming state and mode of a vehicle from its HEARTBEAT.

        vehicle: system id. now: monotonic [s].
        """
        gate = self._gates[vehicle]
        gate.on_state(armed, mode, self._time(gate, now))
        if gate.has_news:
            self._news.add(vehicle)

    def on_request(self, request: Mapping[str, Any], now: float) -> None:
        """Process a request from the supervisor, such as `release` (programs may command the vehicle again).

        `release`: the operator ends the control that land-all or the copilot has taken, so that programs may
        command the vehicle again. request: see `process_context`. now: monotonic [s].
        """
        for gate in self._gates.values():
            gate.on_request(request, self._time(gate, now))
        self._news |= set(self._gates)

    @property
    def has_news(self) -> bool:
        """True if `changes` may return something new."""
        return bool(self._news)

    def changes(self) -> tuple[list[str], dict[str, Any]]:
        """Return what is new since the last call: events (lines of text), and changed facts as {name: value}.

        Both are for the supervisor. The hardware link of a real vehicle reports its events and who has
        control of it, so both are left out here.
        """
        events: list[str] = []
        facts: dict[str, Any] = {}
        for gate in [self._gates[vehicle] for vehicle in sorted(self._news)]:
            own, changed = gate.events(), gate.changed_facts()
            if not gate.simulated:
                changed.pop(f"{gate.name}.control", None)
            facts |= changed
            events += own if gate.simulated else []
        self._news.clear()
        return events, facts

    def take_audit(self) -> list[dict[str, Any]]:
        """Return one audit entry per request that a client has sent to a vehicle since the last call.

        `arena audit` shows the entries. Setpoints have none (see `arena.authority.audit`).
        """
        return [entry for gate in self._gates.values() for entry in gate.audit.take()]

    def _time(self, gate: CommandGate, now: float) -> float:
        return self._sim_now() if gate.simulated and self._sim_now is not None else now
