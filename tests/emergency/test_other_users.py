"""Runs of other users: root lands all of them, members of a group those that are shared with the group.

review fault 17
"""

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

import pytest
from emergency_fleet import Fleet, flying

from arena import run_dirs
from arena.emergency import link_process
from arena.emergency.active_runs import active_runs, active_runs_of_others
from arena.emergency.land_all import land_all
from arena.emergency.run_record import ProcessIdentity, record_command
from arena.emergency.targets import find

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can make files of other users")
ALICE, BOB, LAB = 12340, 12341, 12349


@pytest.fixture
def place(monkeypatch):
    """A folder that every user can reach, used as the folder for temporary files."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    monkeypatch.delenv("ARENA_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder / "none"))
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.chdir(folder)
    yield folder
    shutil.rmtree(folder)


def own(folder, uid, gid, mode=0o700):
    for path in (folder, *folder.rglob("*")):
        os.chown(path, uid, gid)
    folder.chmod(mode)


def make_run(place, host, uid, k=1, gid=None):
    """Make an active run of a user, with one simulated vehicle. gid: group with which it is shared."""
    base = place / f"arena-{uid}"
    runtime, run = base / "lab", place / f"runs-{uid}" / "lab"
    runtime.mkdir(parents=True)
    run.mkdir(parents=True)
    at = 24000 + 10 * k
    link = {"autopilot_host": host, "autopilot_port": at + 4, "partner_host": host, "partner_port": at + 5}
    vehicle = {
        "name": f"uav{k}",
        "id": k,
        "simulated": True,
        "panic": link,
        "router": link,
        "tools_port": at + 6,
    }
    (run / "plan.json").write_text(json.dumps({"vehicles": [vehicle]}))
    (run / "state.json").write_text(json.dumps({"supervisor": {"pid": os.getpid()}, "processes": {}}))
    (runtime / "run").write_text(str(run))
    (runtime / "plan.json").write_text((run / "plan.json").read_text())
    own(run.parent, uid, uid)
    run.chmod(0o700)
    own(base, uid, uid if gid is None else gid, 0o700 if gid is None else 0o750)
    runtime.chmod(0o700 if gid is None else 0o750)
    return run


def command(place, *arguments):
    argv = [sys.executable, "-m", "arena.cli", *map(str, arguments)]
    return subprocess.run(argv, capture_output=True, text=True, timeout=180, check=False, cwd=place)


def as_user(uid, groups, function):
    """Run a function as another user, in a process of its own."""
    pid = os.fork()
    if not pid:
        code = 1
        try:
            os.setgroups(groups)
            os.setresgid(uid, uid, uid)
            os.setresuid(uid, uid, uid)
            function()
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0


@needs_root
def test_root_lands_the_runs_of_all_users(place):
    host = "127.54.60.1"
    runs = [make_run(place, host, uid, k) for k, uid in ((1, ALICE), (2, BOB))]
    (place / "arena.yaml").write_text("address: 127.54.60.9\nvehicles: {other: {id: 9}}\n")
    with Fleet([1, 2], host) as fleet:
        done = command(place, "land-all")
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(a.landed and not a.armed for a in fleet.autopilots.values())
    for k, uid, run in ((1, ALICE, runs[0]), (2, BOB, runs[1])):
        assert f"landing uav{k} (addresses from {run} of user {uid})" in done.stdout
        assert (run / "emergency.jsonl").stat().st_uid == uid, "commanded with the rights of the owner"
    assert "other" not in done.stdout, "the YAML of this folder is not read while a run is active"


@needs_root
def test_root_lands_the_vehicles_named_by_only(place):
    host = "127.54.60.2"
    for k, uid in ((1, ALICE), (2, BOB)):
        make_run(place, host, uid, k)
    with Fleet([1, 2], host) as fleet:
        assert command(place, "kill-all", "--yes", "--only", "uav2").returncode == 0
        assert [a.armed for a in fleet.autopilots.values()] == [True, False]
        assert command(place, "land-all", "--only", "uav3").returncode == 2


@needs_root
def test_an_unconfirmed_vehicle_of_another_user_fails_the_command(place):
    make_run(place, "127.54.60.3", ALICE)
    done = command(place, "land-all", "--timeout", "0.3")
    assert done.returncode == 1 and "uav1: NOT CONFIRMED" in done.stdout


@needs_root
def test_a_link_in_the_run_folder_is_not_written_to(place):
    run, secret = make_run(place, "127.54.60.4", ALICE), place / "secret"
    secret.write_text("")
    (run / "emergency.jsonl").symlink_to(secret)
    command(place, "land-all", "--timeout", "0.1")
    record_command(run, "land-all", ["uav1"])
    assert secret.read_text() == ""


@needs_root
@pytest.mark.parametrize(
    "spoil", ["owner", "group may write", "link", "run is a link", "run of another user"]
)
def test_a_runtime_folder_that_its_owner_does_not_control_is_ignored(place, spoil):
    run = make_run(place, "127.54.60.5", ALICE)
    base = place / f"arena-{ALICE}"
    assert list(active_runs_of_others()) == [ALICE]
    if spoil == "owner":
        os.chown(base, BOB, BOB)
    elif spoil == "group may write":
        (base / "lab").chmod(0o770)
    elif spoil == "link":
        base.rename(place / "elsewhere")
        base.symlink_to(place / "elsewhere")
    elif spoil == "run is a link":
        (base / "lab" / "run").rename(place / "elsewhere")
        (base / "lab" / "run").symlink_to(place / "elsewhere")
    else:
        os.chown(base / "lab" / "run", BOB, BOB)
    assert active_runs_of_others() == {} and run.exists()


@needs_root
def test_a_process_of_another_user_than_the_recording_one_is_not_killed():
    bystander = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    fields = Path(f"/proc/{bystander.pid}/stat").read_text().rpartition(")")[2].split()
    start_s = int(fields[19]) / os.sysconf("SC_CLK_TCK")
    try:
        recorded = ProcessIdentity(name="link.uav1", pid=bystander.pid, start_s=start_s, owner=ALICE)
        assert not link_process.kill(recorded) and bystander.poll() is None
    finally:
        bystander.kill()
        bystander.communicate()


@needs_root
def test_a_member_of_the_group_lands_a_shared_run(place):
    """The run folder is in the owner's home, which the member cannot read."""
    host = "127.54.60.6"
    make_run(place, host, ALICE, gid=LAB)
    with Fleet([flying(1)], host) as fleet:
        as_user(BOB, [LAB], lambda: land_all() == 0 or pytest.fail("not landed"))
    assert fleet.autopilots[1].landed and not fleet.autopilots[1].armed


@needs_root
def test_a_shared_run_names_its_owner_and_own_runs_are_first(place):
    shared, mine = make_run(place, "127.54.60.7", ALICE, gid=LAB), make_run(place, "127.54.60.7", BOB)

    def check():
        found = find()
        assert found.source == f"{mine}, {shared} of user {ALICE}"
        assert [t.run for t in found.targets] == [mine], (
            "the own run wins over another with the same addresses"
        )

    as_user(BOB, [LAB], check)


@needs_root
@pytest.mark.parametrize(("mode", "groups"), [(0o750, []), (0o755, [LAB]), (0o770, [LAB]), (0o777, [LAB])])
def test_a_run_that_is_not_shared_with_the_own_group_is_ignored(place, mode, groups):
    make_run(place, "127.54.60.8", ALICE, gid=LAB)
    (place / f"arena-{ALICE}").chmod(mode)

    def check():
        assert run_dirs.pointers_of_others() == []

    as_user(BOB, groups, check)


@needs_root
def test_the_sessions_folders_of_other_users_are_searched(place, monkeypatch):
    run = make_run(place, "127.54.60.9", ALICE)
    users = place / "user"
    (users / str(ALICE)).mkdir(parents=True)
    (place / f"arena-{ALICE}").rename(users / str(ALICE) / "arena")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(users / str(os.getuid())))
    assert [one.folder for one in active_runs_of_others()[ALICE]] == [run]
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(place))
    assert active_runs_of_others() == {}


@pytest.mark.parametrize("supervisor_runs", [True, False])
def test_review_fault_8_a_run_whose_folder_was_deleted_is_landed(place, supervisor_runs):
    uid = os.getuid()
    run = make_run(place, "127.54.60.10", uid)
    (place / f"arena-{uid}").chmod(0o700)
    shutil.rmtree(run)
    with socket.socket(socket.AF_UNIX) as control:
        control.bind(str(place / f"arena-{uid}" / "lab" / "control.sock"))
        if supervisor_runs:
            control.listen()
        assert [one.folder for one in active_runs()] == ([run] if supervisor_runs else [])
        if supervisor_runs:
            assert [t.name for t in find().targets] == ["uav1"]
