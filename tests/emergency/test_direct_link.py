"""A real vehicle: landed through its link process, beside it, and in its place when it has ended or hangs.

The link is the real process; the vehicle is a fake on UDP or at the other end of a serial cable.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from emergency_fleet import Fleet, flying
from served import Connection, SerialDevice, Served

from arena.emergency import link_process
from arena.emergency.land_all import command, land_all
from arena.emergency.run_record import ProcessIdentity

K = 1
DEADLINE_S = 60.0


def on_serial_line(autopilot, device):
    """Serve a vehicle at the far end of a serial cable."""
    return Served([Connection(autopilot=autopilot, port=SerialDevice(device))])


class Lab:
    """The run folder of a real vehicle, and its link process."""

    def __init__(self, folder, host, wire):
        self.folder, self.host = folder, host
        base = 24000 + 10 * K
        ends = {
            name: {"local": [host, base + at], "remote": [host, base + at + 1]}
            for name, at in (("router", 0), ("vision", 2), ("panic", 4))
        }
        preflight = {
            "position_m": 0.2,
            "yaw_deg": 15.0,
            "pose_age_s": 0.1,
            "pose_rate_hz": 50.0,
            "battery": 0.2,
            "size_m": [7, 4, 3],
            "height_m": 0.1,
            "poses": True,
        }
        slice_ = {
            "name": "link.uav1",
            "vehicle": "uav1",
            "id": K,
            "wire": wire,
            "links": ends,
            "simulator": None,
            "preflight": preflight,
            "params": {},
            "params_file": "",
            "simulated": False,
            "wire_file": str(folder / "wire" / "uav1.json"),
        }
        link = {
            "autopilot_host": host,
            "autopilot_port": base + 4,
            "partner_host": host,
            "partner_port": base + 5,
        }
        vehicle = {
            "name": "uav1",
            "id": K,
            "simulated": False,
            "panic": link,
            "router": link,
            "tools_port": base + 6,
        }
        folder.mkdir()
        self.slice = folder / "link.json"
        self.slice.write_text(json.dumps(slice_))
        (folder / "plan.json").write_text(
            json.dumps({"vehicles": [vehicle], "slices": {"link.uav1.json": slice_}})
        )
        self.link = None

    def start(self):
        """Start the link, wait until it has the vehicle's address, and write state.json as a supervisor does."""
        self.link = subprocess.Popen(
            [sys.executable, "-m", "arena.fcu_link", str(self.slice)], stdout=subprocess.DEVNULL
        )
        self.until(lambda: "vehicle" not in self.seen() or self.seen()["vehicle"])
        fields = Path(f"/proc/{self.link.pid}/stat").read_text().rpartition(")")[2].split()
        start_s = int(fields[19]) / os.sysconf("SC_CLK_TCK")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        state = {
            "boot": boot,
            "supervisor": {"pid": 0},
            "processes": {"link.uav1": {"pid": self.link.pid, "start_s": start_s}},
        }
        (self.folder / "state.json").write_text(json.dumps(state))

    def seen(self):
        file = self.folder / "wire" / "uav1.json"
        return json.loads(file.read_text()) if file.exists() else {"vehicle": None}

    def until(self, check):
        deadline = time.monotonic() + DEADLINE_S
        while not check():
            assert time.monotonic() < deadline and (self.link is None or self.link.poll() is None)
            time.sleep(0.02)

    def signal(self, number):
        self.link.send_signal(number)
        if number == signal.SIGKILL:
            self.link.wait()

    def close(self):
        if self.link is not None:
            self.link.kill()
            self.link.wait()


@pytest.fixture
def lab(tmp_path):
    made = []

    def make(host, wire):
        made.append(Lab(tmp_path / "run", host, wire))
        return made[-1]

    yield make
    for one in made:
        one.close()


def udpin(host):
    return {"kind": "udpin", "address": [host, 14540 + K]}


def lines(capsys):
    return capsys.readouterr().out.splitlines()


def test_a_working_link_records_the_address_and_carries_the_landing(lab, capsys):
    host = "127.66.1.1"
    with Fleet([K], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.start()
        assert site.seen() == {"kind": "udpin", "local": [host, 14541], "vehicle": [host, 25001]}
        assert land_all(run=site.folder) == 0
        assert fleet.autopilots[K].mode == "AUTO.LAND" and site.link.poll() is None
    printed = lines(capsys)
    assert printed[1].startswith("uav1: landed and disarmed") and len(printed) == 2, "no direct connection"


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
@pytest.mark.parametrize("verb", ["land-all", "kill-all"])
def test_a_stopped_or_dead_link_is_replaced(lab, capsys, number, verb):
    host = f"127.66.2.{number + 10 * len(verb)}"
    with Fleet([K], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.start()
        site.signal(number)
        assert command(verb, ["--run", str(site.folder), *(["--yes"] if verb == "kill-all" else [])]) == 0
        assert not fleet.autopilots[K].armed
    printed = lines(capsys)
    assert any(f"sending on udpin {host}:14541 instead" in line for line in printed)
    assert any(f"process {site.link.pid}" in line and "was killed" in line for line in printed) is (
        number == signal.SIGSTOP
    )
    assert site.link.wait(10) == -signal.SIGKILL


def test_a_vehicle_without_known_address_is_found_by_its_telemetry(lab, capsys):
    host = "127.66.3.1"
    site = lab(host, udpin(host))
    with Fleet([K], host, paths=("wire",)):
        assert land_all(run=site.folder) == 0, "only the run folder is left"


def test_a_vehicle_on_udpout_is_commanded_in_place_of_its_link(lab):
    host = "127.66.4.1"
    with Fleet([K], host, paths=("tools",)) as fleet:  # answers every sender
        site = lab(host, {"kind": "udpout", "address": list(fleet.targets[0].tools)})
        site.start()
        site.signal(signal.SIGSTOP)
        (site.folder / "plan.json").write_text(
            (site.folder / "plan.json").read_text().replace("24016", "24019")
        )  # no router
        assert land_all(run=site.folder) == 0


def test_a_link_that_reads_is_never_killed(lab, capsys):
    host = "127.66.5.1"
    with Fleet([K], host, paths=("wire",)):
        site = lab(host, udpin(host))
        site.start()
    assert land_all(run=site.folder, timeout_s=1.5) == 1
    assert site.link.poll() is None
    printed = lines(capsys)
    assert printed[-1].startswith("uav1: NOT CONFIRMED")
    assert any(f"also sending directly to {host}:25001" in line for line in printed)
    assert not any(" instead" in line for line in printed)


def test_another_process_with_the_recorded_pid_is_not_killed():
    bystander = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert link_process.kill(ProcessIdentity(name="link.uav1", pid=bystander.pid, start_s=1.0))
        assert bystander.poll() is None
    finally:
        bystander.kill()
        bystander.communicate()


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_on_a_serial_line_the_device_is_taken_over(lab, serial_cable, capsys, number):
    near, far = serial_cable
    fake = flying(K)
    with on_serial_line(fake, far):
        site = lab(f"127.66.6.{number}", {"kind": "serial", "device": near, "baud": 115200})
        site.start()
        site.signal(number)
        assert land_all(run=site.folder) == 0
    assert fake.mode == "AUTO.LAND" and not fake.armed
    assert any(f"sending on {near} at 115200 baud instead" in line for line in lines(capsys))


def test_from_the_yaml_alone(tmp_path, monkeypatch, serial_cable):
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(tmp_path))
    near, far = serial_cable
    host, file = "127.66.7.1", tmp_path / "arena.yaml"
    file.write_text(
        f'address: {host}\nvehicles:\n  a: {{autopilot: hardware, url: "udpin:{host}:14541", world: [}}\n'
        f"  b: {{autopilot: hardware, url: 'serial:{near}'}}\n"
    )
    other = flying(2)
    with Fleet([1], host, paths=("wire",)) as fleet, on_serial_line(other, far):
        assert land_all(arena=file) == 0
    assert not other.armed and not fleet.autopilots[1].armed


def test_a_second_land_all_is_obeyed_by_the_link_too(lab, end_when):
    """The first one holds our end of the panic link and hangs; there is no router."""
    host = "127.66.8.1"
    with (
        Fleet([K], host, paths=("wire",)) as fleet,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        site = lab(host, udpin(host))
        site.start()
        other.bind((host, 24015))
        end_when(lambda: fleet.autopilots[K].landed and not fleet.autopilots[K].armed)
        assert land_all(run=site.folder) == 1, "no telemetry"
        assert fleet.autopilots[K].landed and not fleet.autopilots[K].armed
