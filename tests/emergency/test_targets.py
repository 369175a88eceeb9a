"""The vehicles that land-all finds: in the plan of a run, else in a YAML that may be broken."""

import dataclasses
import json
import os
from pathlib import Path

import pytest
from emergency_fleet import target
from hypothesis import given
from hypothesis import strategies as st

from arena.emergency import yaml_fallback
from arena.emergency.active_runs import active_runs
from arena.emergency.land_all import kill_all, land_all
from arena.emergency.run_record import DirectAddress, ProcessIdentity
from arena.emergency.targets import choose, find, from_plan, from_yaml, is_replay
from arena.emergency.yaml_fallback import read_yaml, vehicles_of
from arena.errors import InputError
from arena.plan.model import LinkPlan, Plan, VehiclePlan
from arena.schema.ports import vehicle_ports
from arena.transport import DEFAULT_BAUD, ConnectionUrl

HOST = "127.54.20.1"


def named(text):
    address, vehicles = vehicles_of(read_yaml(text))
    return address, [(v.name, v.id) for v in vehicles]


def link(k, at, host=HOST):
    base = 24000 + 10 * k + at
    return LinkPlan(autopilot_host=host, autopilot_port=base, partner_host=host, partner_port=base + 1)


def plan(ids=(1, 2), host=HOST):
    vehicles = tuple(
        VehiclePlan(
            name=f"uav{k}",
            id=k,
            autopilot="builtin",
            profile="iris",
            simulated=True,
            router=link(k, 0, host),
            vision=link(k, 2, host),
            panic=link(k, 4, host),
            port=16000 + k,
            sdk_port=22000 + k,
            tools_port=24006 + 10 * k,
            mocap_body=f"uav{k}",
        )
        for k in ids
    )
    return Plan(name="lab", address=host, vehicles=vehicles, processes=())


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    """Return a function that makes an active run; the runtime folder is empty."""
    monkeypatch.delenv("ARENA_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "rt"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(tmp_path)

    def make(name, a_plan, pid=None):
        folder, rt = tmp_path / "runs" / name, tmp_path / "rt" / "arena" / name
        folder.mkdir(parents=True)
        rt.mkdir(parents=True)
        (rt / "run").write_text(str(folder))
        (folder / "plan.json").write_text(a_plan.to_json())
        state = {"supervisor": {"pid": pid or os.getpid()}, "processes": {}}
        (folder / "state.json").write_text(json.dumps(state))
        return folder

    return make


def test_the_port_rule_equals_the_schemas():
    for k in (1, 7, 250):
        ports, t = vehicle_ports(k), target(k, HOST)
        assert (t.autopilot[1], t.partner[1], t.tools[1]) == (
            ports.panic_autopilot,
            ports.panic_land_all,
            ports.tools,
        )


def test_a_plan_and_its_yaml_give_the_same_addresses(tmp_path):
    file = tmp_path / "arena.yaml"
    file.write_text(f"address: {HOST}\nvehicles:\n  uav1: {{}}\n  uav2: {{id: 2}}\n")
    assert from_yaml(file).targets == from_plan(plan().to_json()) == (target(1, HOST), target(2, HOST))


def test_only_a_simulated_vehicle_uses_the_record_of_its_run(tmp_path):
    raw = json.loads(plan().to_json())
    raw["vehicles"][1]["simulated"] = False
    assert [t.run for t in from_plan(json.dumps(raw), tmp_path)] == [tmp_path, None]


@pytest.mark.parametrize(("radio", "expected"), [("required", True), ("none", False)])
def test_radio_of_a_real_vehicle_is_read_from_plan_and_yaml(tmp_path, radio, expected):
    planned = json.loads(plan(ids=(1,)).to_json())
    planned["vehicles"][0] |= {"simulated": False, "radio": radio}
    assert from_plan(json.dumps(planned))[0].radio is expected
    file = tmp_path / "arena.yaml"
    file.write_text(f"defaults: {{radio: {radio}}}\nvehicles: {{uav1: {{autopilot: hardware}}}}\n")
    assert from_yaml(file).targets[0].radio is expected


def test_manual_mode_of_a_simulated_vehicle_counts_as_before():
    assert from_plan(plan(ids=(1,)).to_json())[0].radio is True


def test_the_running_plan_is_read_before_any_yaml(runtime, tmp_path):
    (tmp_path / "arena.yaml").write_text("vehicles:\n  other:\n")
    folder = runtime("a", plan((3,)))
    assert [run.folder for run in active_runs()] == [folder]
    assert find().targets == (target(3, HOST),)
    assert find().source == str(folder)


def test_every_active_run_is_landed(runtime):
    runtime("a", plan((1,)))
    runtime("b", plan((1,), host="127.54.20.2"))
    assert find().targets == (target(1, HOST), target(1, "127.54.20.2"))


def test_a_yaml_selects_the_run_on_its_address(runtime, tmp_path):
    runtime("a", plan((3,)))
    same, other = tmp_path / "same.yaml", tmp_path / "other.yaml"
    same.write_text(f"address: {HOST}\nvehicles: {{x: }}\n")
    other.write_text("address: 127.54.20.9\nvehicles: {x: }\n")
    assert find(arena=same).targets == (target(3, HOST),)
    assert find(arena=other).targets == (target(1, "127.54.20.9", "x"),)


def test_the_running_plan_wins_over_the_edited_yaml(runtime, tmp_path):
    """The YAML was edited after the start: another address, another vehicle, or broken."""
    file = tmp_path / "lab.yaml"
    for number, edited in enumerate(("address: 127.54.20.9\nvehicles: {x: {id: 9}}\n", "", "vehicles: [")):
        folder = runtime(f"a{number}", plan((3,)))
        (folder / "arena.yaml").write_text(
            f"# resolved from {file}\naddress: {HOST}\nvehicles: {{uav3: {{id: 3}}}}\n"
        )
        file.write_text(edited)
        assert find(arena=file).targets == (target(3, HOST),)


def test_an_unreadable_plan_does_not_stop_other_landings(runtime):
    (runtime("a", plan((1,))) / "plan.json").write_text("{")
    runtime("b", plan((2,), host="127.54.20.2"))
    found = find()
    assert found.targets == (target(2, "127.54.20.2"),)
    assert len(found.unread) == 1 and "runs/a" in found.unread[0]


def test_an_unread_run_is_reported_and_fails_the_command(runtime, monkeypatch, capsys):
    (runtime("a", plan((1,))) / "plan.json").write_text("{")
    runtime("b", plan((2,), host="127.54.20.2"))
    monkeypatch.setattr("arena.emergency.dispatch.bring_down", lambda *_, **__: 0)
    assert land_all() == 1
    assert "NOT COMMANDED" in capsys.readouterr().out.splitlines()[-1]


def test_own_runs_that_others_may_change_are_named_and_fail_the_command(
    runtime, tmp_path, monkeypatch, capsys
):
    runtime("a", plan((1,)))
    runtime("b", plan((2,), host="127.54.20.2"))
    folder = tmp_path / "rt" / "arena" / "a"
    folder.chmod(0o770)
    assert [t.name for t in find().targets] == ["uav2"]
    monkeypatch.setattr("arena.emergency.dispatch.bring_down", lambda *_, **__: 0)
    assert land_all() == 1
    assert f"NOT COMMANDED: the vehicles of runs in {folder}: others may write" in capsys.readouterr().out
    folder.chmod(0o700)
    assert len(find().targets) == 2 and land_all() == 0


def test_nothing_to_land_names_the_folders_that_others_may_change(runtime, tmp_path):
    runtime("a", plan((1,)))
    (tmp_path / "rt" / "arena").chmod(0o777)
    with pytest.raises(InputError, match=f"chmod go-w {tmp_path}/rt/arena, then repeat"):
        find()


UDPIN_URL = ConnectionUrl(kind="udpin", host="0.0.0.0", port=14540)
UDPIN = DirectAddress(connection=UDPIN_URL, local=("0.0.0.0", 14540))


def serial(device, baud=DEFAULT_BAUD):
    return ConnectionUrl(kind="serial", device=device, baud=baud)


URLS = [
    ('"udpin:0.0.0.0:14540"', UDPIN_URL),
    ('"udpout:10.0.0.7:14550"', ConnectionUrl(kind="udpout", host="10.0.0.7", port=14550)),
    ('"serial:/dev/ttyUSB0"', serial("/dev/ttyUSB0")),
    ('"serial:/dev/ttyUSB0", baud: 57600', serial("/dev/ttyUSB0", 57600)),
    ('"serial:/dev/ttyUSB0:115200"', serial("/dev/ttyUSB0", 115200)),
    ('"nonsense"', None),
    ("7", None),
    ('"udpin:host:port"', None),
]


@pytest.mark.parametrize(("url", "connection"), URLS)
def test_a_yaml_gives_the_connection_of_a_real_vehicle(url, connection):
    _, (a, b) = vehicles_of(
        read_yaml(f"vehicles:\n  a: {{autopilot: hardware, url: {url}}}\n  b: {{autopilot: builtin}}\n")
    )
    assert (a.connection, b.connection) == (connection, None)


def test_a_connection_is_read_from_a_broken_yaml_and_from_defaults():
    _, (a,) = vehicles_of(read_yaml('vehicles:\n  a: {id: 4, url: "udpin:0.0.0.0:14540", start: [}\n'))
    assert (a.id, a.connection) == (4, UDPIN_URL)
    _, (a, b) = vehicles_of(
        read_yaml('defaults: {url: "serial:/dev/x"}\nvehicles:\n  a:\n  b: {autopilot: builtin}\n')
    )
    assert (a.connection, b.connection) == (serial("/dev/x"), None)


def test_a_yaml_gives_the_hardware_uid_of_a_real_vehicle(tmp_path):
    file, uid = tmp_path / "arena.yaml", "0102030405060708090A0b0c0d0e0f101112"
    entries = (uid, "none", "7")
    file.write_text(
        "vehicles:\n"
        + "".join(f"  v{i}: {{url: 'udpin:0.0.0.0:14540', uid: {u}}}\n" for i, u in enumerate(entries))
    )
    assert [t.direct.uid for t in from_yaml(file).targets] == [uid.lower(), "", ""]


def real(host=HOST):
    """Return the plan of one real vehicle."""
    slices = {"link.uav1.json": {"wire": {"kind": "udpin", "address": ["0.0.0.0", 14540]}}}
    vehicles = tuple(dataclasses.replace(v, simulated=False) for v in plan((1,), host).vehicles)
    return Plan(name="lab", address=host, vehicles=vehicles, processes=(), slices=slices)


def test_a_run_records_the_last_address_and_the_link_process(runtime):
    folder = runtime("a", real())
    assert find().targets[0].direct == UDPIN
    (folder / "wire").mkdir()
    seen = folder / "wire" / "uav1.json"
    seen.write_text(json.dumps({"kind": "udpin", "local": ["0.0.0.0", 14540], "vehicle": ["10.0.0.7", 9]}))
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    state = {
        "boot": boot,
        "supervisor": {"pid": os.getpid()},
        "processes": {"link.uav1": {"pid": 77, "start_s": 1.5}},
    }
    (folder / "state.json").write_text(json.dumps(state))
    process = ProcessIdentity(name="link.uav1", pid=77, start_s=1.5)
    direct = dataclasses.replace(UDPIN, vehicle=("10.0.0.7", 9), link_process=process)
    assert find(run=folder).targets[0].direct == direct
    (folder / "state.json").write_text(json.dumps({**state, "boot": "another"}))
    assert find(run=folder).targets[0].direct.link_process is None
    seen.write_text(json.dumps({"kind": "udpin", "uid": "0102030405060708"}))
    assert find(run=folder).targets[0].direct.uid == "0102030405060708"
    for broken in ("{", "[]", '{"kind": "serial"}', '{"kind": "udpin", "vehicle": 3}', '{"uid": "nonsense"}'):
        seen.write_text(broken)
        assert find(run=folder).targets[0].direct == UDPIN


def test_a_run_without_processes_is_not_active(runtime):
    gone = next(pid for pid in range(2**22 - 1, 0, -1) if not Path(f"/proc/{pid}").exists())
    runtime("a", plan(), pid=gone)
    assert active_runs() == []


def test_a_state_that_cannot_be_read_counts_as_running(runtime):
    folder = runtime("a", plan())
    (folder / "state.json").write_text("{")
    assert [run.folder for run in active_runs()] == [folder]


def test_a_broken_plan_falls_back_to_the_yaml_of_its_run(runtime):
    folder = runtime("a", plan())
    (folder / "plan.json").write_text('{"vehicles": [{"name": ')
    (folder / "arena.yaml").write_text(f"address: {HOST}\nvehicles:\n  uav1:\n")
    assert find(run=folder).targets == find().targets == (target(1, HOST),)


def test_nothing_to_land_says_what_to_do(runtime):
    with pytest.raises(InputError, match="no run is active, and there is no"):
        find()


def test_the_yaml_of_this_folder_is_the_last_resort(runtime, tmp_path):
    (tmp_path / "arena.yaml").write_text("vehicles:\n  uav1:\n")
    assert [t.name for t in find().targets] == ["uav1"]


@pytest.mark.parametrize(
    "text",
    [
        "vehicles:\n  a:\n  b:\n",
        "vehicles: {a: {}, b: {profile: nosuch, start: {position: [.nan, 0, 0]}}}\n",
        "wrold: {size: [1, 2\nvehicles:\n  a: {profile: iris}\n  b: {profile: iris}\n",
        "vehicles:\n  a: {profile: iris\n  b:\n    start: [0, 0\n",
        "vehicles:\n  a:\n\tprofile: iris\n  b: {}\n",
        "vehicles:\n  a: {program: 'x}\n  b: {}\nsim: [}\n",
        "vehicles:\n  a: *nowhere\n  b: &x {}\n",
        "%bad directive\nvehicles:\n  a:\n  b:\n",
        'name: @x\n"vehicles":\n    a: !!python/object:os.system {}\n    b: 2\n',
        "vehicles:\n  a:\n  b:\nvehicle: [",
        "\ufeffvehicles:\r\n  a:\r\n  b: {\r\n",
    ],
)
def test_a_yaml_with_errors_still_names_its_vehicles(text):
    assert named(text) == ("127.0.0.1", [("a", 1), ("b", 2)])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("vehicles: {a: , b: {id: 1}, c: }", [("a", 2), ("b", 1), ("c", 3)]),
        ("vehicles:\n  a: {id: 7, start: [}\n  b:\n    id: 4\n    start: [\n", [("a", 7), ("b", 4)]),
        ("vehicles: {a: {id: many}, b: {id: true}, c: {id: 999}}", [("a", 1), ("b", 2), ("c", 3)]),
    ],
)
def test_ids_are_as_written_or_the_lowest_free(text, found):
    assert named(text)[1] == found


def test_a_broken_yaml_keeps_its_address():
    assert vehicles_of(read_yaml("address: 127.0.0.7\nworld: [\nvehicles:\n  a: {\n"))[0] == "127.0.0.7"


@pytest.mark.parametrize("text", ["", "vehicles:", "vehicles: 3", "[1, 2]", "\x00\x01", "{{{{", "a: b: c: d"])
def test_a_file_without_vehicles_is_refused(tmp_path, text):
    file = tmp_path / "arena.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match="the file names no vehicle"):
        from_yaml(file)


@given(st.text(alphabet="ab: \n\t{}[],#'\"&*!%-1", max_size=120))
def test_any_text_is_read_without_an_error(text):
    vehicles_of(read_yaml(text))


def test_only_and_except_select_and_refuse_unknown_names():
    all_ = tuple(target(k, HOST) for k in (1, 2, 3))
    assert choose(all_, only=["uav2"]) == (all_[1],)
    assert choose(all_, spared=["uav2"]) == (all_[0], all_[2])
    with pytest.raises(InputError, match="got vehicle uav9, expected one of uav1, uav2, uav3"):
        choose(all_, only=["uav9"])


def test_a_plan_with_an_additional_field_is_read():
    raw = dataclasses.asdict(plan())
    raw["vehicles"][0]["new"] = 1
    assert len(from_plan(json.dumps(raw))) == 2


@pytest.mark.parametrize(
    "url",
    ["udpin:0.0.0.0:99999", "udpout:10.0.0.1:65536", "udpout:drone.lab:14550", "udpin:::1:5", "udpin::5"],
)
def test_a_vehicle_with_an_invalid_url_is_still_landed(tmp_path, url):
    file = tmp_path / "arena.yaml"
    file.write_text(f'address: {HOST}\nvehicles:\n  uav1: {{autopilot: hardware, url: "{url}"}}\n  uav2:\n')
    assert from_yaml(file).targets == (target(1, HOST), target(2, HOST))
    assert from_yaml(file).targets[0].direct is None


def test_an_invalid_address_is_not_looked_up_as_a_name():
    assert named("address: 999.1.1.1\nvehicles:\n  uav1:\n") == ("127.0.0.1", [("uav1", 1)])


def replay_plan(*, simulated=True):
    made = plan((1,), host="127.0.77.1")
    vehicles = tuple(dataclasses.replace(v, simulated=simulated) for v in made.vehicles)
    return dataclasses.replace(made, vehicles=vehicles, replay="/runs/a/flight.mcap")


def test_replay_is_named_and_never_commanded(runtime):
    folder = runtime("a", replay_plan())
    found = find()
    assert (found.targets, found.replays) == ((), (str(folder),))
    assert (find(run=folder).targets, find(run=folder).replays) == ((), (str(folder),))


def test_land_all_on_a_replay_says_that_nothing_flies_and_waits_for_nothing(runtime, capsys, monkeypatch):
    def commanded(*_: object) -> None:
        pytest.fail("a replay is commanded: land-all then waits for its landing")

    monkeypatch.setattr("arena.emergency.land_all.send_first_commands", commanded)
    folder = runtime("a", replay_plan())
    assert land_all() == 0
    assert land_all(run=folder) == 0
    assert kill_all(yes=True) == 0
    assert capsys.readouterr().out.count(f"not commanded: {folder} is a replay") == 3


def test_flight_beside_a_replay_is_landed(runtime):
    runtime("a", replay_plan())
    flight = runtime("b", plan((1,)))
    found = find()
    assert (found.source, found.targets) == (str(flight), (target(1, HOST),))
    assert len(found.replays) == 1


def test_real_vehicles_of_the_yaml_are_landed_while_only_a_replay_runs(runtime, tmp_path):
    runtime("a", replay_plan())
    yaml = tmp_path / "arena.yaml"
    yaml.write_text(
        f"address: {HOST}\nvehicles: {{uav1: {{autopilot: hardware, url: 'udpin:127.0.0.1:14540'}}}}\n"
    )
    assert [t.name for t in find().targets] == ["uav1"]
    yaml.write_text(f"address: {HOST}\nvehicles:\n  uav1: {{}}\n")
    assert find().targets == ()
    assert find(arena=yaml).targets == (target(1, HOST),)


def test_plan_of_a_flight_is_not_parsed_to_see_that_it_is_no_replay(runtime, monkeypatch):
    runtime("b", plan((1,)))
    (run,) = active_runs()
    parsed = []
    monkeypatch.setattr("arena.emergency.targets.json.loads", parsed.append)
    assert not is_replay(run) and parsed == []


def test_run_that_cannot_be_read_beside_a_replay_is_not_a_success(runtime, tmp_path):
    runtime("a", replay_plan())
    flight = runtime("b", plan((1,)))
    for file in flight.glob("plan.json"):
        file.unlink()
    with pytest.raises(InputError, match="nothing to land"):
        land_all()
    (tmp_path / "arena.yaml").write_text(f"address: {HOST}\nvehicles:\n  uav1: {{}}\n")
    assert find().targets == (target(1, HOST),)


def test_plan_with_a_real_vehicle_is_commanded_even_if_it_says_replay(runtime):
    runtime("a", replay_plan(simulated=False))
    assert [t.name for t in find().targets] == ["uav1"]
    assert find().replays == ()


def test_yaml_that_gives_a_refused_id_keeps_it() -> None:
    """Ports follow the id: with another vehicle's id, land-all would command the other vehicle."""
    text = "vehicles:\n  big: {id: 250}\n  uav: {}\n  uav9: {}\n"
    found = yaml_fallback.vehicles_of(yaml_fallback.read_yaml(text))[1]
    assert [(v.name, v.id) for v in found] == [("big", 250), ("uav", 1), ("uav9", 2)]


@pytest.mark.parametrize(
    ("autopilot", "simulated", "ends"),
    [("builtin", True, True), ("px4", True, True), ("hitl", True, False), ("hardware", False, False)],
)
def test_only_a_vehicle_without_hardware_ends_with_its_world(autopilot, simulated, ends):
    planned = plan([1])
    (vehicle,) = planned.vehicles
    changed = dataclasses.replace(
        planned, vehicles=(dataclasses.replace(vehicle, autopilot=autopilot, simulated=simulated),)
    )
    assert from_plan(changed.to_json())[0].ends_with_world is ends
