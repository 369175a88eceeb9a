"""The arm permit of a real vehicle, from `arena up` to `arena arm-permit`. A fake autopilot stands in for the vehicle."""

from __future__ import annotations

from fake_autopilot import FakeAutopilot
from served import Connection, Served, UdpPort

from .flight import Flight, Hangar, eventually

TELEMETRY = ("HEARTBEAT", "SYS_STATUS", "ATTITUDE", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE")


def battery(flight: Flight) -> float | None:
    """Return the charge of uav1's battery that the link has received; None before it has."""
    found: float | None = flight.status()["processes"]["link.uav1"]["stats"].get("battery")
    return found


def test_a_vehicle_that_connects_late_or_again_needs_its_own_permit(hangar: Hangar) -> None:  # review fault 3
    first, second = (hangar.address, 14540), (hangar.address, 14541)
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: permit
address: {hangar.address}
preflight: {{params: false, battery: 0}}
defaults: {{autopilot: hardware, profile: iris, radio: none, forward: false}}
vehicles:
  uav1: {{url: "udpin:{first[0]}:{first[1]}"}}
  uav2: {{url: "udpin:{second[0]}:{second[1]}"}}
""")
    uav = FakeAutopilot(system=1, uid2=bytes(range(1, 19)), telemetry=TELEMETRY, period_s=0.05)
    late = FakeAutopilot(system=2, uid2=bytes(range(2, 20)), telemetry=TELEMETRY, period_s=0.05)
    late.mute = True
    wires = [
        Connection(autopilot=uav, port=UdpPort((hangar.address, 14999)), remote=first),
        Connection(autopilot=late, port=UdpPort((hangar.address, 14998)), remote=second),
    ]
    with Served(wires):
        flight = hangar.up(file, "--yes", "--no-report")

        def has_event(text: str) -> bool:
            return any(text in entry.get("event", "") for entry in flight.events())

        eventually(lambda: has_event("uav1: arm permit granted by"), 90, "the first permit", flight.said)
        flight.until_said("uav2: not connected, so it has no arm permit", 30)
        late.mute = False
        uav.mute = True
        eventually(lambda: has_event("withdrawn: no telemetry for 3 s"), 60, "its withdrawal", flight.said)
        uav.mute = False
        eventually(lambda: has_event("connected again"), 60, "the vehicle again", flight.said)
        eventually(lambda: "processes ready" in flight.said(), 60, "the late vehicle", flight.said)
        eventually(lambda: battery(flight) is not None, 60, "the battery", flight.said)
        given = flight.cli("arm-permit", "uav1")
        assert given.returncode == 0, given.stdout + given.stderr
        assert f"uav1: uid {uav.uid2.hex()}, {hangar.address}:14999, battery 87 %" in given.stdout
        eventually(lambda: has_event("(arena arm-permit)"), 60, "the second permit", flight.said)
        assert not has_event("uav2: arm permit granted")
        refused = flight.cli("arm-permit", "uav9")
        assert refused.returncode != 0 and "expected a real vehicle: uav1" in refused.stderr
