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
        with starting_alone(120.0):
            order.append("second")

    second = threading.Thread(target=start)
    with starting_alone():
        second.start()
        second.join(0.2)
        order.append("first")
    second.join(120.0)
    assert order == ["first", "second"]


def test_stopped_arena_blocks_no_other_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with starting_alone(), starting_alone(0.05):
        pass  # both are in the block


def test_arena_starts_without_a_lock_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with starting_alone():
        assert not (tmp_path / "missing").exists()
