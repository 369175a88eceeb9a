"""Programs that are no Python files: C++ with MAVLink's C headers, C++ with MAVSDK's library, and a shell script."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pymavlink
import pytest

from .flight import PROGRAMS, ROOT, Hangar

PAGE = ROOT / "docs" / "howto" / "programs-in-other-languages.md"
ARENA = """
name: languages
defaults: {{autopilot: builtin}}
vehicles:
  uav1: {{program: fly, args: ["{{address}}", "{{port}}", "{{id}}"], start: {{position: [-2, 0, 0]}}}}
  uav2: {{program: fly.sh, args: ['{python}']}}
"""
WITH_MAVSDK = "  uav3: {program: sdk, args: ['{sdk_url}'], start: {position: [2, 0, 0]}}\n"
HOVER = """
from arena import UAV
with UAV.from_args() as uav:
    uav.start_offboard_mission()
    uav.set_pos_yaw(uav.ekf.pos + [0.0, 0.0, -1.0], 0.0, 4.0)
    uav.auto_land()
"""


def block(start: str) -> str:
    """Return the code block of the page whose text begins with `start`."""
    return next(
        b for b in re.findall(r"^```\w+\n(.*?)^```$", PAGE.read_text(), re.M | re.S) if b.startswith(start)
    )


def compile_cpp(source: Path, target: Path, *options: str) -> None:
    command = [
        "g++",
        "-O1",
        "-std=c++17",
        "-Wall",
        "-Wno-address-of-packed-member",
        str(source),
        "-o",
        str(target),
    ]
    made = subprocess.run([*command, *options], capture_output=True, text=True, check=False, timeout=300)
    assert made.returncode == 0, made.stderr


def compile_mavlink_program(folder: Path) -> None:
    messages = Path(pymavlink.__path__[0]) / "dialects" / "v20" / "common.xml"
    generator = [sys.executable, "-m", "pymavlink.tools.mavgen", "--lang", "C", "--wire-protocol", "2.0"]
    words = [*generator, "--no-validate", "-o", str(folder / "include"), str(messages)]
    subprocess.run(words, check=True, capture_output=True, timeout=120)
    (folder / "fly.cpp").write_text(block("// Arms a vehicle"))
    compile_cpp(folder / "fly.cpp", folder / "fly", "-I", str(folder / "include"))


def compile_mavsdk_program(folder: Path) -> bool:
    """Compile the program for MAVSDK's library of the package mavsdk 4. Return False if it is not installed."""
    try:
        import mavsdk
    except ImportError:
        return False
    library = Path(mavsdk.__path__[0]) / "lib" / "libcmavsdk.so"
    if not library.is_file():
        return False
    found = re.search(rb"libcmavsdk\.so\.\d+", library.read_bytes())
    assert found is not None
    link = folder / found[0].decode()
    link.symlink_to(library)
    compile_cpp(PROGRAMS / "fly_with_mavsdk.cpp", folder / "sdk", str(link), f"-Wl,-rpath,{folder}")
    return True


@pytest.mark.flight
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_programs_in_c_and_shell_fly_and_land(hangar: Hangar, tmp_path: Path) -> None:
    compile_mavlink_program(tmp_path)
    with_mavsdk = compile_mavsdk_program(tmp_path)
    script = tmp_path / "fly.sh"
    script.write_text(block("#!/bin/sh").replace("exec python", 'exec "$1"'))
    script.chmod(0o755)
    (tmp_path / "hover.py").write_text(HOVER)
    yaml = tmp_path / "arena.yaml"
    yaml.write_text(ARENA.format(python=sys.executable) + (WITH_MAVSDK if with_mavsdk else ""))
    flight = hangar.up(yaml, "--until-done", "--speed", "max")
    assert flight.wait(90) == 0, flight.said()
    assert "sim.speed is 1 instead of max" in flight.said()
    north, _, down = map(float, re.findall(r"-?\d+\.\d+", flight.log("program.uav1").partition("at ")[2]))
    assert north == pytest.approx(-1.5, abs=0.3) and down == pytest.approx(-1.0, abs=0.3)
    assert "flying uav2, 1.52 kg" in flight.log("program.uav2")
    assert not [name for name in ("uav1", "uav2") if flight.outcome["facts"].get(f"{name}.armed")]
    for name in ("uav1", "uav2", *(["uav3"] if with_mavsdk else [])):
        seen = flight.verdict(name)
        assert seen["max_height_m"] > 0.6 and not seen["crashed"], (name, seen)
