"""The wheel builder: what it reports about missing tools, about its compiler, and about wheels that are not complete."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "build_wheels.py"


@pytest.fixture
def tool() -> ModuleType:
    """Import tools/build_wheels.py."""
    spec = spec_from_file_location("build_wheels", TOOL)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_missing_tools_are_named(
    tool: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(tool, "find_spec", lambda name: None if name in ("ziglang", "auditwheel") else name)
    monkeypatch.setattr(tool.sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setattr(tool, "build", pytest.fail)
    assert tool.main() == 1
    said = capsys.readouterr().err.splitlines()
    assert said[:2] == [
        "wheels: ziglang is missing: pip install ziglang",
        "wheels: auditwheel is missing: pip install auditwheel",
    ]
    assert (
        said[2].startswith(f"wheels: Python's headers are missing ({tmp_path}/Python.h)") and len(said) == 3
    )


def test_each_architecture_has_its_compiler(tool: Any, tmp_path: Path) -> None:
    for architecture in ("x86_64", "aarch64"):
        made = tool.environment(architecture, tmp_path / "setup.cfg")
        assert f"-target {architecture}-linux-gnu.2.17" in made["CC"] and made["CC"] in made["LDSHARED"]
        assert made["SETUPTOOLS_EXT_SUFFIX"] == tool.suffix(architecture)


def test_incomplete_wheel_is_reported(tool: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wheel = tmp_path / "a.whl"
    good, other = tool.suffix("aarch64"), tool.suffix("x86_64")
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in ("k/one.pxd", f"k/one{good}", "k/two.pxd", f"k/three{other}"):
            archive.writestr(name, "")
    audited = 'a.whl is consistent with the following\nplatform tag: "manylinux_2_17_aarch64".'
    monkeypatch.setattr(
        tool.subprocess, "run", lambda *_, **more: SimpleNamespace(stdout=audited, stderr="", returncode=0)
    )
    assert tool.problems(wheel, "aarch64") == [
        "k/two is not compiled",
        f"k/three{other} is of another system",
    ]
    audited = audited.replace("2_17", "2_34")
    assert "auditwheel: not manylinux_2_17_aarch64" in tool.problems(wheel, "aarch64")[-1]


def test_builder_without_its_tools_says_so_as_a_command(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-S", str(TOOL)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 1 and "ziglang is missing: pip install ziglang" in done.stderr
