"""setup.py on a computer that cannot compile: the package is built without kernels, and one line says why and what to do."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Copy the files that setup.py needs, without compiled kernels."""
    made = tmp_path / "checkout"
    shutil.copytree(ROOT / "arena", made / "arena", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    for name in ("setup.py", "pyproject.toml", "README.md", "MANIFEST.in", "LICENSE"):
        shutil.copy(ROOT / name, made)
    return made


def build_ext(checkout: Path, compiler: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"],
        cwd=checkout,
        env={**os.environ, "CC": compiler, "LDSHARED": compiler},
        capture_output=True,
        text=True,
        check=False,
    )


def test_build_without_a_compiler_says_once_what_would_help(checkout: Path) -> None:
    done = build_ext(checkout, str(checkout / "no-such-compiler"))
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("arena: no C compiler that finds Python's headers") == 1
    assert "apt install gcc python3-dev" in done.stderr
    assert not list((checkout / "arena").rglob("*.so")) and not (checkout / "build" / "kernels").exists()


def test_build_without_headers_shows_the_error_and_says_once_what_would_help(checkout: Path) -> None:
    compiler = checkout / "gcc-without-headers"
    compiler.write_text("#!/bin/sh\necho 'fatal error: Python.h: No such file or directory' >&2\nexit 1\n")
    compiler.chmod(0o755)
    done = build_ext(checkout, str(compiler))
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("Python.h: No such file") == 1, "one attempt, not one per kernel"
    assert done.stderr.count("arena: no C compiler that finds Python's headers") == 1
    assert not list((checkout / "arena").rglob("*.so"))


def test_package_contains_the_pages_of_reports(checkout: Path, tmp_path: Path) -> None:
    """Without its templates an installed arena could write no report."""
    for folder in ("profiles", "templates"):
        shutil.copytree(ROOT / folder, checkout / folder)
    subprocess.run(
        [sys.executable, "setup.py", "-q", "build_py", "--build-lib", str(tmp_path / "built")],
        cwd=checkout,
        env={**os.environ, "ARENA_NO_COMPILE": "1"},
        capture_output=True,
        check=True,
    )
    source, built = ROOT / "arena" / "report" / "page", tmp_path / "built" / "arena" / "report" / "page"
    assert (
        {file.name for file in built.iterdir()}
        == {file.name for file in source.iterdir()}
        > {"run.html", "page.js"}
    )
