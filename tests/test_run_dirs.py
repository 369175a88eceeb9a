"""Files of this user in the folder for temporary files."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from arena.run_dirs import open_lock_file


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
