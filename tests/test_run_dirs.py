"""Files of this user in the folder for temporary files."""

from __future__ import annotations

import os
import tempfile
import threading
from pathlib import Path

import pytest

from arena.run_dirs import open_lock_file, starting_alone


def test_symbolic_link_in_place_of_a_lock_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    target = tmp_path / "target"
    target.write_text("kept")
    (tmp_path / f"arena-x-{os.getuid()}.lock").symlink_to(target)
    with pytest.raises(OSError, match="symbolic links"):
        open_lock_file("x")
    assert target.read_text() == "kept"


def test_arena_waits_until_the_one_before_has_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    order: list[str] = []

    def start() -> None:
        with starting_alone(order.append, 120.0):
            order.append("second")

    second = threading.Thread(target=start)
    with starting_alone(order.append):
        second.start()
        while not order:  # until it says that it waits
            second.join(0.05)
        order.append("first")
    second.join(120.0)
    assert order == ["waiting, because another arena is starting", "first", "second"]


def test_stopped_arena_blocks_no_other_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    said: list[str] = []
    with starting_alone(said.append), starting_alone(said.append, 0.05):
        assert said == ["another arena has been starting for 0.05 s: not waiting for it any longer"]


def test_arena_starts_without_a_lock_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    said: list[str] = []
    with starting_alone(said.append):
        assert not (tmp_path / "missing").exists()
    assert said == []
