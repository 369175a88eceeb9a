"""Replacement of a file as a whole."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from arena.whole_file import replace_file


def test_file_is_created_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "push.json"
    replace_file(path, "old\n")
    with path.open() as reader:
        replace_file(path, "new\n")
        assert reader.read() == "old\n"
    assert path.read_text() == "new\n" and list(tmp_path.iterdir()) == [path]


def test_text_is_on_the_disk_before_the_file_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, seen = tmp_path / "push.json", list[str]()
    path.write_text("old")
    monkeypatch.setattr(os, "fsync", lambda fd: seen.append(path.read_text()))
    replace_file(path, "new")
    assert seen == ["old"] and path.read_text() == "new"


def test_full_disk_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "push.json"
    path.write_text("old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*/push.json'"):
        replace_file(path, "new")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
