"""Compiled kernels are used only if they were compiled from the present sources."""

from __future__ import annotations

import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from arena.kernels import why_interpreted
from arena.kernels.source_digest import (
    compiled_names,
    digest_as_c,
    kernel_names,
    source_digest,
    stored_digest,
)


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a kernel and a module without Python source. Files contain the digest of the sources, as compiled modules do."""
    monkeypatch.delenv("ARENA_INTERPRETED", raising=False)
    (tmp_path / "lift.py").write_text("def lift() -> float:\n    return 1.0\n")
    (tmp_path / "lift.pxd").write_text("cdef double lift()\n")
    (tmp_path / "tail.pyx").write_text("cdef double tail\n")
    (tmp_path / "arrays.py").write_text("# a module without a .pxd file is not compiled\n")
    for name in ("lift", "tail"):
        stored = digest_as_c(name, source_digest(tmp_path)).encode()
        (tmp_path / f"{name}{EXTENSION_SUFFIXES[0]}").write_bytes(b"\x7fELF\0" + stored + b"\0")
    return tmp_path


def test_kernels_are_the_modules_with_a_pxd_file(kernels: Path) -> None:
    assert kernel_names(kernels) == ["lift"]
    assert compiled_names(kernels) == ["lift", "tail"]


def test_kernels_compiled_from_the_present_sources_are_used(kernels: Path) -> None:
    assert why_interpreted(kernels) is None


@pytest.mark.parametrize("name", ["lift.py", "lift.pxd", "tail.pyx"])
def test_kernels_of_other_sources_are_not_used(kernels: Path, name: str) -> None:
    with (kernels / name).open("a") as file:
        file.write("# changed\n")
    assert "have changed since they were compiled" in (why_interpreted(kernels) or "")


@pytest.mark.parametrize("name", ["lift", "tail"])
def test_missing_compiled_kernels_name_what_to_install(kernels: Path, name: str) -> None:
    (kernels / f"{name}{EXTENSION_SUFFIXES[0]}").unlink()
    assert "apt install gcc python3-dev" in (why_interpreted(kernels) or "")


def test_environment_selects_the_python_source(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARENA_INTERPRETED", "1")
    assert "ARENA_INTERPRETED" in (why_interpreted(kernels) or "")


def test_file_without_a_digest_has_none(tmp_path: Path) -> None:
    (tmp_path / "x.so").write_bytes(b"\x7fELF")
    assert stored_digest(tmp_path / "x.so") is None


def test_setting_without_compiler_runs_every_kernel_from_its_source() -> None:
    """`ARENA_INTERPRETED=1` imports the .py file although a compiled module lies beside it."""
    code = (
        "import importlib, arena.kernels as k\n"
        "names = k.kernel_names(k._FOLDER)\n"
        "assert names and all(importlib.import_module(f'arena.kernels.{n}').__file__.endswith('.py') for n in names)"
    )
    subprocess.run(
        [sys.executable, "-c", code], check=True, env={"ARENA_INTERPRETED": "1", "PYTHONPATH": _ROOT}
    )


_ROOT = str(Path(__file__).parents[2])
