"""A real vehicle: landed through its link process, beside it, and in its place when it has ended or hangs.

The link is the real process; the vehicle is a fake on UDP or at the other end of a serial cable.
"""

import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from emergency_fleet import Fleet, flying
from fake_autopilot import ARM, LAND, SET_MODE
from served import Connection, SerialDevice, Served, UdpPort, until

from arena.authority.command_gate import pack_reply
from arena.constants import PILOT_HAS_CONTROL
from arena.emergency import direct_link, link_process, link_restart
from arena.emergency.land_all import command, land_all
from arena.emergency.run_record import ProcessIdentity
from arena.whole_file import replace_file
from arena.wire.mavlink_codec import Codec

K = 1
OURS, OTHER = bytes(range(1, 19)), bytes(range(2, 20))
DEADLINE_S = 60.0


def on_serial_line(autopilot, device):
    """Serve a vehicle at the far end of a serial cable."""
    return Served([Connection(autopilot=autopilot, port=SerialDevice(device))])


def start_time(pid):
    """Return the start time of a process [s since boot]; 0 if there is none."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return int(fields[19]) / os.sysconf("SC_CLK_TCK")


class Lab:
    """The run folder of a real vehicle, and its link process.

    supervisor: pid in state.json; 0: none
    """

    supervisor = 0

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
            "tilt_deg": 10.0,
            "imu": False,
            "pose_age_s": 0.1,
            "pose_rate_hz": 50.0,
            "battery": 0.2,
            "size_m": [7, 4, 3],
            "height_m": 0.1,
            "poses": True,
            "radio": [0],
            "axes_check": False,
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
            "missing_reboots": {"folder": "/nowhere", "address": ""},
            "params_file": "",
            "simulated": False,
            "uid": "",
            "body": "uav1",
            "capture": None,
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
        self.write_state()

    def write_state(self):
        """Write state.json with the link process, as a supervisor does."""
        start_s = start_time(self.link.pid)
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        state = {
            "boot": boot,
            "supervisor": {"pid": self.supervisor, "start_s": start_time(self.supervisor)},
            "processes": {"link.uav1": {"pid": self.link.pid, "start_s": start_s}},
        }
        replace_file(self.folder / "state.json", json.dumps(state))  # land-all may read at this moment

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


def test_a_working_link_records_the_address_and_carries_the_landing(lab, capsys, monkeypatch):
    monkeypatch.setattr(direct_link, "BESIDE_AFTER_S", 60.0)  # the link of a busy machine is slow, but works
    host = "127.66.1.1"
    with Fleet([flying(K, uid2=OURS)], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.start()
        seen = {"kind": "udpin", "local": [host, 14541], "vehicle": [host, 25001], "uid": OURS.hex()}
        site.until(lambda: site.seen() == seen)
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
    assert land_all(run=site.folder, timeout_s=5.0) == 1
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


def test_review_fault_5_a_pilots_vehicle_is_refused_by_its_link(lab, capsys):
    """The pilot has control from the start, so land-all commands the vehicle, and the hardware link refuses."""
    host = "127.66.11.1"
    fake = flying(K, mode="POSCTL", uid2=OURS)
    with Fleet([fake], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.start()
        site.until(lambda: site.seen().get("uid") == OURS.hex())
        ticks = fake.ticks
        until(lambda: fake.ticks > ticks + 20)  # the link has received heartbeats of the identified vehicle
        assert land_all(run=site.folder, timeout_s=5.0) == 1
    assert not {SET_MODE, LAND, ARM} & set(orders(fleet.autopilots[K]))
    last = lines(capsys)[-1]
    assert last.startswith("uav1: NOT CONFIRMED: armed, in the air, mode POSCTL")
    assert last.endswith("refused: denied (pilot has control)")


def test_review_fault_5_a_pilots_vehicle_is_not_commanded_past_its_link(lab, capsys):
    """The link process has ended. A direct connection passes no gate that refuses the command."""
    host = "127.66.12.1"
    with Fleet([flying(K, mode="POSCTL", uid2=OURS)], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.start()
        site.until(lambda: site.seen().get("uid") == OURS.hex())
        site.signal(signal.SIGKILL)
        assert land_all(run=site.folder, timeout_s=5.0) == 1
        assert not {SET_MODE, LAND, ARM} & set(orders(fleet.autopilots[K]))
    assert "uav1: a pilot may have control: not commanded directly" in lines(capsys)


def test_review_fault_5_a_refusal_of_the_router_forbids_direct_commands(lab, capsys):
    """The link process hangs and the vehicle is not received, but the router knows that a pilot has control."""
    host = "127.66.13.1"
    refusal = pack_reply(Codec(K, 1), SET_MODE, (253, 0), (PILOT_HAS_CONTROL,), 2)
    with (
        Fleet([flying(K, uid2=OURS)], host, paths=("wire",)) as fleet,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router,
    ):
        router.bind((host, 24016))
        threading.Thread(target=answer, args=(router, refusal), daemon=True).start()
        site = lab(host, udpin(host))
        site.start()
        site.until(lambda: site.seen().get("uid") == OURS.hex())
        fleet.autopilots[K].mute = True
        site.signal(signal.SIGSTOP)
        assert land_all(run=site.folder, timeout_s=5.0) == 1
        assert not {SET_MODE, LAND, ARM} & set(orders(fleet.autopilots[K]))
        router.sendto(b"", (host, 24016))
    assert "uav1: a pilot may have control: not commanded directly" in lines(capsys)


def answer(sock, reply):
    """Send the reply to the sender of each datagram, until an empty one arrives."""
    while True:
        data, sender = sock.recvfrom(65535)
        if not data:
            return
        sock.sendto(reply, sender)


# review fault 10: the supervisor restarts a crashed link process


def start_link_later(site, when):
    """Start the link process again once `when` holds, as a supervisor does. Return the thread."""

    def restart():
        until(when)
        site.link = subprocess.Popen(
            [sys.executable, "-m", "arena.fcu_link", str(site.slice)], stdout=subprocess.DEVNULL
        )
        site.write_state()

    thread = threading.Thread(target=restart)
    thread.start()
    return thread


def test_review_fault_10_a_restarting_link_keeps_its_port(lab, capsys, monkeypatch):
    monkeypatch.setattr(link_restart, "RESTART_S", 60.0)
    host = "127.66.9.1"
    with Fleet([flying(K, land_s=3.0)], host, paths=("wire",)) as fleet:
        site = lab(host, udpin(host))
        site.supervisor = os.getpid()
        site.start()
        site.signal(signal.SIGKILL)
        again = start_link_later(site, lambda: fleet.autopilots[K].commands)
        assert land_all(run=site.folder) == 0
        again.join()
        assert site.link.poll() is None, "the link process could open its port"
    printed = lines(capsys)
    assert "uav1: link.uav1 is not running; waiting for its restart" in printed
    assert not any(" instead" in line for line in printed)


@pytest.mark.parametrize("state", ["FATAL", "EXITED", "READY"])
def test_review_fault_10_the_wait_ends_when_the_supervisor_gives_up(lab, capsys, monkeypatch, state):
    monkeypatch.setattr(link_restart, "RESTART_S", 0.5 if state == "READY" else 60.0)
    host = f"127.66.9.{10 + len(state)}"
    with Fleet([K], host, paths=("wire",)):
        site = lab(host, udpin(host))
        site.supervisor = os.getpid()
        site.start()
        site.signal(signal.SIGKILL)
        event = {"process": "link.uav1", "from": "STARTING", "to": state, "reason": "exit -9"}
        (site.folder / "events.jsonl").write_text(json.dumps(event) + "\n")
        assert land_all(run=site.folder) == 0
    assert any(f"sending on udpin {host}:14541 instead" in line for line in lines(capsys))


def land_when_link_sends(fake):
    """Let a vehicle in AUTO.LAND land as soon as its link process sends to it. Return the thread."""

    def land():
        until(lambda: fake.mode == "AUTO.LAND")
        count = len(fake.received)
        until(lambda: any(m.get_srcComponent() == 192 for m in fake.received[count:]), 60.0)
        fake.land_s = 0.0

    thread = threading.Thread(target=land)
    thread.start()
    return thread


def test_review_fault_10_a_link_that_comes_back_gets_its_port_back(lab, capsys):
    host = "127.66.9.3"
    fake = flying(K, land_s=math.inf)
    with Fleet([fake], host, paths=("wire",)):
        site = lab(host, udpin(host))
        site.start()
        site.signal(signal.SIGKILL)
        again = start_link_later(site, lambda: fake.mode == "AUTO.LAND")
        landing = land_when_link_sends(fake)
        assert land_all(run=site.folder) == 0
        again.join()
        landing.join()
        assert site.link.poll() is None
    printed = lines(capsys)
    assert any(" instead" in line for line in printed)
    assert f"uav1: link.uav1 runs again; udpin {host}:14541 is released for it" in printed


def test_review_fault_10_a_serial_device_is_given_back(lab, serial_cable, capsys):
    near, far = serial_cable
    fake = flying(K, land_s=math.inf)
    with on_serial_line(fake, far):
        site = lab("127.66.9.4", {"kind": "serial", "device": near, "baud": 115200})
        site.start()
        site.signal(signal.SIGKILL)
        again = start_link_later(site, lambda: fake.mode == "AUTO.LAND")
        landing = land_when_link_sends(fake)
        assert land_all(run=site.folder) == 0
        again.join()
        landing.join()
    assert f"uav1: link.uav1 runs again; {near} at 115200 baud is released for it" in lines(capsys)


# review fault 4: another vehicle with the same system id


class Bench(Served):
    """A vehicle on UDP that sends to an address from a port of its own."""

    def __init__(self, autopilot, local, remote):
        self.autopilot = autopilot
        super().__init__([Connection(autopilot=autopilot, port=UdpPort(local), remote=remote)])


def recorded(site, host, uid, address=None):
    """Write the record of a link process that has ended."""
    (site.folder / "wire").mkdir()
    seen = {"kind": "udpin", "local": [host, 14541], "vehicle": address, "uid": uid.hex()}
    (site.folder / "wire" / "uav1.json").write_text(json.dumps(seen))


def orders(autopilot):
    return [c.command for c in autopilot.orders]


@pytest.mark.parametrize("same_address", [False, True])
def test_review_fault_4_another_vehicle_never_confirms_a_landing(lab, capsys, same_address):
    """The vehicle of the run is silent; a vehicle with its system id stands on the bench and sends telemetry."""
    host = f"127.66.10.{1 + same_address}"
    bench = flying(K, landed=True, armed=False, uid2=OTHER)
    site = lab(host, udpin(host))
    local = (host, 25009)
    recorded(site, host, OURS, list(local) if same_address else [host, 25008])
    with Bench(bench, local, (host, 14541)):
        assert land_all(run=site.folder, timeout_s=5.0) == 1
    assert not {SET_MODE, LAND, ARM} & set(orders(bench)), "never commanded"
    printed = lines(capsys)
    assert printed[-1] == "uav1: NOT CONFIRMED: no telemetry received"
    assert any(f"another vehicle replies at {host}:25009 (hardware uid {OTHER.hex()}" in p for p in printed)


def test_review_fault_4_the_vehicle_is_found_at_a_new_address(lab, capsys):
    host = "127.66.10.3"
    ours, bench = flying(K, uid2=OURS), flying(K, landed=True, armed=False, uid2=OTHER)
    site = lab(host, udpin(host))
    recorded(site, host, OURS, ["127.66.10.4", 25001])
    with Bench(bench, (host, 25009), (host, 14541)), Bench(ours, (host, 25010), (host, 14541)):
        assert land_all(run=site.folder) == 0
    assert ours.landed and not ours.armed and LAND in orders(ours)
    assert not {SET_MODE, LAND, ARM} & set(orders(bench))
    assert "uav1: landed and disarmed after" in lines(capsys)[-1]


@pytest.mark.parametrize("number", [None, signal.SIGKILL])
def test_review_fault_4_the_uid_that_the_link_has_recorded_is_checked(lab, capsys, number):
    """The vehicle falls silent in flight, and a vehicle on the bench with its system id is switched on."""
    host = f"127.66.10.{6 if number is None else 7}"
    ours, bench = flying(K, uid2=OURS), flying(K, landed=True, armed=False, uid2=OTHER)
    site = lab(host, udpin(host))
    with Bench(ours, (host, 25009), (host, 14541)):
        site.start()
        site.until(lambda: site.seen().get("uid") == OURS.hex())
        ours.alive = False
        if number is not None:
            site.signal(number)
        with Bench(bench, (host, 25010), (host, 14541)):
            assert land_all(run=site.folder, timeout_s=5.0) == 1
    assert not {SET_MODE, LAND, ARM} & set(orders(bench))
    assert lines(capsys)[-1].startswith("uav1: NOT CONFIRMED")


def test_without_a_recorded_uid_a_line_reports_it(lab, capsys):
    host = "127.66.10.5"
    site = lab(host, udpin(host))
    with Fleet([K], host, paths=("wire",)):
        assert land_all(run=site.folder) == 0
    line = "uav1: its hardware uid is not recorded: the identity of the vehicle is not checked"
    assert line in lines(capsys)
