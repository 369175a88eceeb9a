"""Tests of the table of MAVLink ids: no two programs have the same ids, and no vehicle has one of them."""

from __future__ import annotations

import ast
import itertools
from pathlib import Path

import pytest

from arena.authority import Role, role_of_tool, role_on_link
from arena.errors import InputError
from arena.schema import load_arena
from arena.wire import mavlink_ids
from arena.wire.mavlink_ids import LARGEST_VEHICLE_ID, SENDERS, VEHICLE_COMPONENTS, Sender

ARENA = Path(mavlink_ids.__file__).parents[1]
ROLES = {250: Role.GROUND_STATION, 251: Role.COPILOT, 253: Role.EMERGENCY}
"""System id -> role that it gives at a tools port and on the router link. All other ids of the table give none."""


def test_table_contains_every_sender_of_the_module() -> None:
    assert set(SENDERS) == {value for value in vars(mavlink_ids).values() if isinstance(value, Sender)}


def test_no_two_programs_can_have_the_same_ids() -> None:
    for one, other in itertools.combinations(SENDERS, 2):
        shared = one.components & other.components if one.system == other.system else set()
        assert not shared, f"{one.program} and {other.program} share {one.system}/{sorted(shared)}"


@pytest.mark.parametrize("sender", SENDERS, ids=lambda s: s.program)
def test_ids_are_valid_and_none_is_that_of_an_autopilot(sender: Sender) -> None:
    assert LARGEST_VEHICLE_ID < sender.system <= 255
    assert sender.component in sender.components <= set(range(2, 256))


def test_signed_component_is_outside_the_range_of_the_processes() -> None:
    for sender in SENDERS:
        assert sender.signed not in range(sender.first, sender.last + 1)
        assert sender.component_at(signs=True) == (sender.signed or sender.component)
        assert sender.component_at(signs=False) == sender.component


def test_new_processes_are_no_new_senders_at_a_vehicle_that_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle refuses all senders after the 16th, also the next `land-all`."""
    never_at_it = (
        mavlink_ids.REFEREE,
        mavlink_ids.VIEWER,
    )  # simulated vehicles only; the router forwards no PING
    found = set()
    for pid in range(1000, 1060):
        monkeypatch.setattr("os.getpid", lambda pid=pid: pid)
        found |= {(s.system, s.component_at(signs=True)) for s in SENDERS if s not in never_at_it}
    assert len(found) == len(SENDERS) - len(never_at_it)


def test_processes_with_adjacent_ids_have_different_components(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for pid in range(1000, 1015):
        monkeypatch.setattr("os.getpid", lambda pid=pid: pid)
        found.append(mavlink_ids.HOLD.component)
    assert len(set(found)) == 15


@pytest.mark.parametrize("sender", SENDERS, ids=lambda s: s.program)
def test_system_ids_give_the_roles_that_they_have_always_given(sender: Sender) -> None:
    assert role_of_tool(sender.system) is ROLES.get(sender.system, Role.PROGRAM)
    for link in ("router", "vision"):
        assert role_on_link(link, sender.system, 1) is ROLES.get(sender.system, Role.GROUND_STATION)
    copilot = sender is mavlink_ids.COPILOT
    assert role_on_link("panic", sender.system, 1) is (Role.COPILOT if copilot else Role.EMERGENCY)


def test_program_of_every_possible_vehicle_has_the_role_program() -> None:
    for system in range(1, LARGEST_VEHICLE_ID + 1):
        assert role_on_link("router", system, system) is Role.PROGRAM
        assert role_of_tool(system) is Role.PROGRAM


def test_arena_refuses_a_vehicle_with_an_id_of_a_program(tmp_path: Path) -> None:
    file = tmp_path / "arena.yaml"
    file.write_text(f"vehicles:\n  uav1: {{id: {LARGEST_VEHICLE_ID}}}\n")
    assert load_arena(file).vehicles[0].id == LARGEST_VEHICLE_ID
    for system in {sender.system for sender in SENDERS}:
        file.write_text(f"vehicles:\n  uav1: {{id: {system}}}\n")
        with pytest.raises(InputError, match=rf"vehicles\.uav1\.id: .*at most {LARGEST_VEHICLE_ID}"):
            load_arena(file)


def test_components_of_a_vehicle_contain_the_autopilot() -> None:
    assert set(VEHICLE_COMPONENTS) == {1, 158, 191, 192, 197}


def test_no_other_module_contains_an_id_of_its_own() -> None:
    """A sender is made with ids of a configuration or of the table, never with a number."""
    senders = ("Codec", "MinimalSender")
    texts = {file: file.read_text() for file in ARENA.rglob("*.py")}
    found = [
        f"{file}:{node.lineno}: system id {ast.unparse(node.args[0])}"
        for file, text in texts.items()
        if any(name in text for name in senders)  # parsing every file takes seconds
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
        if node.func.id in senders and isinstance(node.args[0], ast.Constant)
    ]
    assert not found
