"""Checks of the machine before an arena starts, and the choice of a free address."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from arena.errors import InputError, NotInstalledError
from arena.plan import Plan, make_plan
from arena.plan.machine import AddressChoice, Machine, check_machine, choose_address
from arena.schema import Arena, load_arena

FLEET = """\
tools: {rec: {argv: [sleep, "1e3"]}}
vehicles:
  uav1: {autopilot: builtin, program: fly.py}
  uav2: {autopilot: builtin, program: fly.py, port: 17002, start: {position: [-2, 0, 0]}}
"""
NATNET = "mocap: {source: natnet, server: 10.0.0.2}\n"


class Bench(Machine):
    """A machine with the given modules, commands and UDP ports in use.

    held: (address, port) -> process that holds it, "" when the kernel does not reveal it; address "" for any.
    """

    def __init__(
        self,
        modules: bool = True,
        commands: bool = True,
        held: dict[tuple[str, int], str] | None = None,
        no_such_address: bool = False,
    ) -> None:
        self.modules, self.commands, self.held = modules, commands, held or {}
        self.no_such_address = no_such_address

    def has_module(self, name: str) -> bool:
        return self.modules

    def has_device(self, path: str) -> bool:
        return False

    def has_command(self, name: str, folder: str) -> bool:
        return self.commands

    def refusal(self, address: str, port: int) -> str:
        if self.no_such_address:
            return "cannot be bound (Cannot assign requested address)"
        return "in use" if {(address, port), ("", port)} & set(self.held) else ""

    def holder(self, address: str, port: int) -> str:
        return self.held.get((address, port), self.held.get(("", port), ""))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fly.py").touch()
    return tmp_path


def load(text: str = FLEET) -> tuple[Arena, Plan]:
    Path("arena.yaml").write_text(text)
    arena = load_arena("arena.yaml")
    return arena, make_plan(arena)


def refused(bench: Machine, text: str = FLEET) -> list[str]:
    """Return the lines of the error."""
    with pytest.raises(InputError) as raised:
        check_machine(*load(text), bench)
    return str(raised.value).splitlines()


def test_machine_with_everything_passes() -> None:
    check_machine(*load(), Bench())


def test_missing_software_is_named_with_the_command_to_get_it() -> None:
    with pytest.raises(NotInstalledError) as raised:
        check_machine(*load(), Bench(modules=False, commands=False))
    assert str(raised.value).splitlines() == [
        "pybullet is not installed, but uav1, uav2 must be simulated. Try: pip install 'flying-arena[sim]'",
        "arena.yaml: tools.rec: the command 'sleep' was not found on this computer. Install or rename it.",
    ]


def test_ports_in_use_give_one_line_per_process() -> None:
    held = {("", port): "pid 41 (arena:router)" for port in (24000, 24011, 24016, 24018, 24021)}
    held |= {("", 17002): "pid 7 (qgroundcontrol)", ("", 24002): ""}
    another = "Set another `address`, such as 127.0.0.2."
    assert refused(Bench(held=held)) == [
        "arena.yaml: UDP ports 24000, 24011, 24016, 24018 and 1 more of 127.0.0.1, for router, "
        f"in use by pid 41 (arena:router). {another}",
        f"arena.yaml: UDP port 24002 of 127.0.0.1, for recorder, in use. {another}",
        "arena.yaml: UDP port 17002 of 127.0.0.1, for program.uav2, in use by pid 7 (qgroundcontrol). "
        + another,
    ]


def test_no_message_advises_to_end_another_process() -> None:
    for line in refused(Bench(held={("", 24000): "pid 41 (x)", ("", 1510): ""})):
        assert not any(word in line.lower() for word in ("kill", "end that", "stop it"))


def test_address_of_another_computer_gives_one_line() -> None:
    assert refused(Bench(no_such_address=True), "address: 192.0.2.1\n" + FLEET) == [
        "arena.yaml: 192.0.2.1 cannot be bound (Cannot assign requested address). "
        "Set `address` to an address of this computer."
    ]


def test_port_of_a_hardware_url_in_use_asks_for_another_url() -> None:
    text = (
        NATNET
        + "vehicles: {uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14540'}}\n"
    )
    (line,) = refused(Bench(held={("0.0.0.0", 14540): "pid 9 (mavproxy)"}), text)
    assert line == (
        "arena.yaml: UDP port 14540 of 0.0.0.0, for link.uav1, in use by pid 9 (mavproxy). "
        "Set another port in the `url`."
    )


def test_ports_that_px4_binds_on_every_address_ask_for_other_ids(tmp_path: Path) -> None:
    binary, scripts = tmp_path / "px4/bin/px4", tmp_path / "px4/etc/init.d-posix"
    for made in (binary.parent, scripts):
        made.mkdir(parents=True)
    binary.touch(mode=0o755)
    (scripts / "rcS").touch()
    held = {("0.0.0.0", port): "pid 41 (arena:world)" for port in (24034, 27006)}
    (line,) = refused(Bench(held=held), "px4: {home: px4}\nvehicles: {a: {autopilot: px4, id: 3}}\n")
    assert line == (
        "arena.yaml: UDP ports 24034, 27006 of 0.0.0.0, for px4.a, in use by pid 41 (arena:world). PX4 binds these "
        "ports on every address, so another `address` does not help. The port numbers depend on the vehicle's `id`: "
        "set another `id`."
    )


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
def test_holder_of_a_port_on_every_address_is_found_on_any_address(address: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind(("127.0.0.1", 0))
        found = Machine().holder(address, held.getsockname()[1])
    assert found.startswith(f"pid {os.getpid()} (")


def test_missing_serial_device_is_named() -> None:
    (line,) = refused(Bench(), "vehicles: {uav1: {autopilot: hitl, serial: /dev/ttyACM0}}\n")
    assert "/dev/ttyACM0, the serial device of uav1, does not exist" in line


def test_ports_of_other_programs_may_be_in_use() -> None:
    check_machine(
        *load(), Bench(held=dict.fromkeys([("", 14550), ("", 22001), ("", 24015), ("", 1511)], "x"))
    )


def test_real_machine_names_the_process_that_holds_a_port() -> None:
    arena, plan = load("address: 127.52.1.1\n" + FLEET)
    check_machine(arena, plan)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind(("127.52.1.1", 24002))
        with pytest.raises(
            InputError, match=rf"24002 of 127.52.1.1, for recorder, in use by pid {os.getpid()} \("
        ):
            check_machine(arena, plan)
    check_machine(arena, plan)


def test_default_address_is_kept_when_it_is_free() -> None:
    assert choose_address(load()[1], {}, Bench()) == AddressChoice(address="127.0.0.1")


def test_address_of_another_run_is_skipped_with_its_name() -> None:
    choice = choose_address(load()[1], {"127.0.0.1": "run /runs/lab", "127.0.0.2": "run /runs/lab2"}, Bench())
    assert choice == AddressChoice(
        address="127.0.0.3", why="127.0.0.1 is in use by run /runs/lab: using 127.0.0.3"
    )


def test_address_with_a_port_in_use_is_skipped_with_the_process() -> None:
    choice = choose_address(load()[1], {}, Bench(held={("127.0.0.1", 24002): "pid 7 (x)"}))
    assert choice.why == "127.0.0.1 is in use by pid 7 (x): using 127.0.0.2"
    choice = choose_address(load()[1], {}, Bench(held={("127.0.0.1", 1510): ""}))
    assert choice.why == "127.0.0.1 is in use by another process (UDP port 1510): using 127.0.0.2"


def test_no_free_address_is_an_error() -> None:
    with pytest.raises(
        InputError, match=r"The addresses 127.0.0.1 to 127.0.0.50 are all in use. Set `address` in the YAML"
    ):
        choose_address(load()[1], {}, Bench(held={("", 24000): "pid 1 (x)"}))
