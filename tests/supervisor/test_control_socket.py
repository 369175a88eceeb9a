"""Users who may command a running arena: its owner and root, as the kernel reports the user of a connection."""

from __future__ import annotations

import json
import os
import selectors
import socket
from pathlib import Path

import pytest

from arena import run_dirs
from arena.emergency import targets
from arena.supervisor import active_runs, control_socket, lab_group
from arena.supervisor.control_socket import ControlServer


class Served:
    """A control server on a path, turned by hand."""

    def __init__(self, path: Path, **more) -> None:
        self.path, self.selector, self.told = path, selectors.DefaultSelector(), []
        self.asked: list[dict] = []
        self.server = ControlServer(path, self.selector, self.answer, refused=self.told.append, **more)

    def answer(self, request):
        self.asked.append(request)
        return {"ok": True}

    def ask(self) -> bytes:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(30)
            client.connect(str(self.path))
            client.sendall(b'{"do": "down"}\n')
            for _ in range(2):  # accepted, then read
                for key, _ in self.selector.select(0.2):
                    key.data()
            return client.recv(4096)


@pytest.fixture
def serve(runtime_dir):
    made = []

    def start(**more):
        made.append(Served(runtime_dir / "control.sock", **more))
        return made[-1]

    yield start
    for one in made:
        one.server.close()


def test_the_owner_is_answered(serve):
    served = serve()
    assert json.loads(served.ask()) == {"ok": True}
    assert served.asked == [{"do": "down"}] and not served.told


def test_another_user_is_refused_and_counted(serve):
    """The server believes this process's own user to be another."""
    served = serve(users=[os.getuid() + 1])
    for _ in range(3):
        assert json.loads(served.ask()) == {
            "error": f"user {os.getuid()} is not allowed to command this arena"
        }
    assert not served.asked and served.server.refused == {os.getuid(): 3}
    assert served.told == [
        f"refused a connection of user {os.getuid()}: only the owner and root may command this arena"
    ]


def test_control_socket_is_readable_by_its_owner_only(serve, runtime_dir):
    served = serve()
    assert served.path.stat().st_mode & 0o777 == 0o600
    assert [p.name for p in runtime_dir.iterdir()] == ["control.sock"]


def test_members_of_a_shared_folders_group_are_answered(serve, runtime_dir, monkeypatch):
    """review fault 17. The kernel lets only members open the socket."""
    monkeypatch.setattr(control_socket, "_user", lambda _: os.getuid() + 1)
    lab_group.share_folder(runtime_dir, os.getgid())
    served = serve()
    assert served.path.stat().st_mode & 0o777 == 0o660 and served.path.stat().st_gid == os.getgid()
    assert json.loads(served.ask()) == {"ok": True}


@pytest.mark.parametrize("spoil", ["everybody may write", "a group may write", "a link"])
def test_runtime_folder_writable_by_others_is_ignored(tmp_path, monkeypatch, spoil):
    base, real = tmp_path / "base", tmp_path / "real"
    run = tmp_path / "runs" / "a"
    for folder in (real / "a", run):
        folder.mkdir(parents=True)
    (real / "a" / "run").write_text(str(run))
    (run / "state.json").write_text("{")
    monkeypatch.setenv("ARENA_RUNTIME_DIR", str(real))
    assert [one.folder for one in targets.active_runs()] == [run], "as long as it is ours alone"
    if spoil == "a link":
        base.symlink_to(real)
        monkeypatch.setenv("ARENA_RUNTIME_DIR", str(base))
    else:
        real.chmod(0o777 if spoil == "everybody may write" else 0o770)
    assert run_dirs.pointers() == [] and targets.active_runs() == [] and active_runs() == []
