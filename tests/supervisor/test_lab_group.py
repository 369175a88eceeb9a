"""The runtime folder of a run that is shared with a group of the computer. review fault 17"""

import grp
import os
import shutil
import tempfile
from pathlib import Path

import pytest

from arena.errors import RunError
from arena.supervisor import create
from tests.supervisor.conftest import plan_of


@pytest.fixture
def base(tmp_path, monkeypatch):
    """The folder for runtime folders that other users can reach."""
    short = Path(tempfile.mkdtemp())  # paths of sockets must be short
    (short / "session").mkdir()
    monkeypatch.delenv("ARENA_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short / "session"))
    monkeypatch.setattr(tempfile, "tempdir", str(short))
    yield short / f"arena-{os.getuid()}"
    shutil.rmtree(short)


def modes(folder):
    return [
        path.stat().st_mode & 0o777 for path in (folder.parent, folder, folder / "run", folder / "plan.json")
    ]


def test_a_run_is_shared_with_the_group_of_the_lab(base, tmp_path, monkeypatch):
    monkeypatch.setenv("ARENA_GROUP", grp.getgrgid(os.getgid()).gr_name)
    shared = create(plan_of(), tmp_path / "runs")
    assert shared.rt.parent == base, "other users cannot reach XDG_RUNTIME_DIR"
    assert modes(shared.rt) == [0o750, 0o750, 0o640, 0o640]
    assert (shared.rt / "plan.json").read_text() == (shared.path / "plan.json").read_text()


def test_without_a_group_only_the_owner_can_read_the_runtime_folder(base, tmp_path, monkeypatch):
    monkeypatch.delenv("ARENA_GROUP", raising=False)
    own = create(plan_of(), tmp_path / "runs")
    assert own.rt.parent == base.parent / "session" / "arena" and modes(own.rt)[:2] == [0o700, 0o700]


def test_an_unshared_run_leaves_a_shared_one_readable(base, tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setenv("ARENA_GROUP", grp.getgrgid(os.getgid()).gr_name)
    create(plan_of(), tmp_path / "runs")
    monkeypatch.delenv("ARENA_GROUP")
    own = create(plan_of(), tmp_path / "runs")
    assert modes(own.rt)[:2] == [0o750, 0o700]


def test_an_unknown_group_is_refused(base, tmp_path, monkeypatch):
    monkeypatch.setenv("ARENA_GROUP", "no-such-group")
    with pytest.raises(RunError, match="ARENA_GROUP: got no-such-group, expected the name of a group"):
        create(plan_of(), tmp_path / "runs")


def test_a_group_without_this_user_is_refused(base, tmp_path, monkeypatch):
    monkeypatch.setenv("ARENA_GROUP", grp.getgrgid(os.getgid()).gr_name)
    monkeypatch.setattr(os, "geteuid", lambda: 12340)
    monkeypatch.setattr(os, "getegid", lambda: 12340)
    monkeypatch.setattr(os, "getgroups", list)
    with pytest.raises(RunError, match="this user does not belong to the group"):
        create(plan_of(), tmp_path / "runs")
