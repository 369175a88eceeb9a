"""How a program learns which vehicle it flies."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from arena.clock import SimClock, WallClock
from arena.clock_server import ClockServer
from arena.errors import InputError
from arena.uav import UAV
from arena.uav.arguments import read_arguments

from .conftest import free_address

PROFILE = {
    "mass_kg": 1.3,
    "radius_m": 0.295,
    "height_m": 0.222,
    "num_rotors": 4,
    "thrust_curve": {"kind": "quadratic", "a": 30.0, "b": 5.0},
}


def slice_file(tmp_path, **more):
    host, port = free_address()
    settings = {
        "name": "program.uav2",
        "vehicle": "uav2",
        "id": 2,
        "link": f"udpin:{host}:{port}",
        "capture": None,
        "body": "aero2",
        "clock": None,
        "profile": PROFILE,
        "neighbours": [{"name": "uav1", "id": 1}],
        "neighbours_stale_s": 0.7,
        "beacons": [{"name": "door", "number": 3}],
        "beacons_stale_s": 3.0,
        "stale_s": 0.4,
        **more,
    }
    file = tmp_path / "program.uav2.json"
    file.write_text(json.dumps(settings))
    return file


def test_the_supervisors_slice_is_enough_and_the_rest_is_the_programs(tmp_path):
    with UAV.from_args(["--uav", str(slice_file(tmp_path)), "--laps", "3", "fast"]) as uav:
        assert uav.args == ["--laps", "3", "fast"]
        assert (uav.info.drone_ns, uav.info.mass, uav.info.radius, uav.info.height) == (
            "uav2",
            1.3,
            0.295,
            0.222,
        )
        assert isinstance(uav.clock, WallClock)
        assert list(uav.sen.neighbours) == ["uav1"] and list(uav.sen.beacons) == ["door"]


def test_a_simulation_clock_is_used_where_there_is_one(tmp_path):
    server = ClockServer(tmp_path / "clock")
    server.tick(12.5)
    try:
        with UAV.from_args(["--uav", str(slice_file(tmp_path, clock=str(tmp_path / "clock")))]) as uav:
            assert isinstance(uav.clock, SimClock) and uav.clock.now() == 12.5
    finally:
        server.close()


def test_by_hand_the_profile_gives_the_figures():
    found = read_arguments(
        ["--ns", "uav3", "--profile", "intel_aero", "--link", "udpin:127.56.3.1:16003", "left"]
    )
    assert (found["system_id"], found["mass"] < 1.4, found["args"]) == (3, True, ["left"])


def test_by_hand_the_link_follows_from_the_id():
    assert read_arguments(["--id", "4"])["link"] == "udpin:127.0.0.1:16004"


def test_by_hand_a_motion_capture_server_is_named_by_its_address():
    found = read_arguments(["--ns", "uav1", "--capture", "natnet:10.0.0.5:unicast", "--body", "aero"])
    capture = found["capture"]
    assert (capture["server"], capture["transport"], capture["local"]) == ("10.0.0.5", "unicast", None)
    assert (capture["bodies"], found["body"]) == (["aero"], "aero")
    assert read_arguments(["--capture", "natnet:127.0.0.2"])["capture"]["group"] == "239.192.0.2"
    assert read_arguments([])["capture"] is None


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--uav", "/nowhere.json"], "nowhere.json"),
        (["--ns", "alpha"], "--id"),
        (["--profile", "irsi"], "iris"),
        (["--link", "tcp:1"], "udpin:HOST:PORT"),
        (["--capture", "vrpn:10.0.0.5"], "expected one of natnet"),
        (["--capture", "natnet:motive"], "natnet:10.0.0.5"),
        (["--capture", "natnet:10.0.0.5:tcp"], "multicast"),
    ],
)
def test_what_is_wrong_is_said(argv, said):
    with pytest.raises(InputError, match=said):
        UAV(**read_arguments(argv))


def test_a_slice_that_lacks_a_key_names_it(tmp_path):
    file = tmp_path / "x.json"
    file.write_text('{"profile": {}}')
    with pytest.raises(InputError, match="mass_kg"):
        read_arguments(["--uav", str(file)])


def test_importing_arena_is_light():
    code = "import sys, arena; print(any(m in sys.modules for m in ('numpy', 'pymavlink', 'matplotlib', 'pydantic')))"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "False"
    )


def test_a_program_does_not_import_what_it_does_not_need():
    heavy = "('matplotlib', 'pydantic', 'pybullet', 'rich')"
    code = f"import sys; from arena import UAV; print([m for m in {heavy} if m in sys.modules])"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


def test_program_below_a_shell_script_finds_its_vehicle_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("ARENA_UAV_FILE", str(slice_file(tmp_path)))
    monkeypatch.setattr(sys, "argv", ["hover.py", "--laps", "2"])
    found = read_arguments()
    assert (found["ns"], found["system_id"], found["args"]) == ("uav2", 2, ["--laps", "2"])


@pytest.mark.parametrize("option", [("--ns", "uav1"), ("--id", "1"), ("--link", "udpin:127.0.0.1:1")])
def test_options_select_another_vehicle_than_the_environment(tmp_path, monkeypatch, option):
    monkeypatch.setenv("ARENA_UAV_FILE", str(slice_file(tmp_path)))
    monkeypatch.setattr(sys, "argv", ["hover.py", *option])
    assert read_arguments()["ns"] == "uav1"
