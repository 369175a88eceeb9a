"""Sockets that a run opens, from its plan, and the lines about them of `arena up` and `arena check`."""

from __future__ import annotations

import json

import pytest

from arena.plan import make_plan
from arena.plan.open_ports import open_lines, open_sockets
from arena.schema import load_arena


def plan_of(folder, **keys):
    file = folder / "arena.yaml"
    arena = {
        "vehicles": {
            "uav1": {"autopilot": "builtin"},
            "uav2": {"autopilot": "builtin", "start": {"position": [1, 1, 0]}},
        }
    }
    file.write_text(json.dumps({**arena, **keys}))
    return make_plan(load_arena(file))


@pytest.mark.parametrize("address", ["127.0.0.1", "127.66.40.1"])
def test_arena_on_the_loopback_opens_nothing(tmp_path, address):
    plan = plan_of(tmp_path, address=address)
    assert open_lines(plan) == [] and all(opened.local for opened in open_sockets(plan))


def test_page_of_the_monitor_is_listed(tmp_path):
    (page,) = [
        s for s in open_sockets(plan_of(tmp_path, tools={"monitor": True})) if s.process == "tool.monitor"
    ]
    assert (page.protocol, page.address, page.port) == ("tcp", "127.0.0.1", 8480) and page.local
    argv = ["arena", "monitor", "--host", "0.0.0.0", "--port", "9000"]
    plan = plan_of(tmp_path, tools={"monitor": {"argv": argv}})
    (line,) = open_lines(plan)
    assert line.startswith("open: tcp 0.0.0.0:9000 monitor page (tool.monitor)") and "token" in line


def test_every_port_of_the_plan_is_listed_with_its_senders(tmp_path):
    plan = plan_of(tmp_path)
    listed = {(spec.name, x.protocol, x.address, x.port) for spec in plan.processes for x in spec.listens}
    assert listed <= {(d.process, d.protocol, d.address, d.port) for d in open_sockets(plan)}
    assert all(d.what and d.who and "?" not in d.who for d in open_sockets(plan))


def test_ports_that_other_computers_reach_are_listed(tmp_path):
    lines = open_lines(plan_of(tmp_path, address="192.168.77.5"))
    assert "open: udp 192.168.77.5:24016,24026 tools (router) answers this computer only" in lines
    assert (
        "open: udp 192.168.77.5:24014,24024 panic link (world) answers commands from this computer only"
        in lines
    )
    assert (
        "open: udp 192.168.77.5:24000 ground stations (router) answers the addresses that the YAML names"
        in lines
    )
    assert any(":1510 NatNet commands (mocap) answers any client that asks" in line for line in lines)
    assert any("239.255.42.99:1511 NatNet frames, shared" in line for line in lines)


def test_hardware_port_on_every_address_is_listed(tmp_path):
    real = {
        "uav1": {"autopilot": "hardware", "profile": "iris", "radio": "none", "url": "udpin:0.0.0.0:14540"}
    }
    lines = open_lines(plan_of(tmp_path, vehicles=real, mocap={"source": "natnet", "server": "127.66.40.9"}))
    assert lines == [
        "open: udp 0.0.0.0:14540 flight controller (link.uav1) answers the first address that sends as this vehicle"
    ]


def test_ports_of_fifty_vehicles_share_a_line(tmp_path):
    vehicles = {f"v{k}": {"autopilot": "builtin", "start": {"position": [k, 0, 0]}} for k in range(1, 51)}
    plan = plan_of(tmp_path, address="192.168.77.5", world={"size": [200, 10, 3]}, vehicles=vehicles)
    (tools,) = [line for line in open_lines(plan) if " tools " in line]
    assert tools == "open: udp 192.168.77.5:24016..24506[50] tools (world) answers this computer only"
