"""Rules, defaults and layers of a sound arena, and where each value came from."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from arena.mocap.vendors import vendor_settings
from arena.plan import make_plan
from arena.schema import Arena, load_arena

TWO = """\
vehicles:
  uav1: {profile: iris, start: {position: [0, 0, 0]}, program: position_setpoints.py}
  uav2: {profile: iris, start: {position: [-2, 0, 0]}, program: position_setpoints.py}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "position_setpoints.py").touch()
    (tmp_path / "fly").touch(mode=0o755)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(text: str, *overrides: str) -> Arena:
    Path("arena.yaml").write_text(text)
    return load_arena("arena.yaml", overrides)


def source(arena: Arena, key: str) -> str:
    return arena.origins[key].source


def group(arena: Arena) -> str:
    """Return the multicast group that the emulator serves."""
    return vendor_settings("natnet").server_settings(arena.mocap.keys, arena.address)["group"]


def test_two_lines_are_a_complete_arena(folder: Path) -> None:
    arena = load(TWO)
    assert arena.name == "".join(c if c.isalnum() or c in "_-." else "-" for c in folder.name).strip("-._")
    assert (arena.address, arena.world.size, arena.mocap.rate_hz, group(arena)) == (
        "127.0.0.1",
        (7.0, 4.0, 3.0),
        180.0,
        "239.255.42.99",
    )
    one, two = arena.vehicles
    assert (one.id, one.ports.program, one.ports.sdk) == (1, 16001, 22001)
    assert (two.id, two.ports.program, two.ports.sdk) == (2, 16002, 22002)
    assert (one.pose_rate_hz, one.forward, one.mocap_body, one.autopilot, one.asked) == (
        60.0,
        True,
        "uav1",
        "builtin",
        "auto",
    )
    assert one.program is not None and one.program.path == str(folder / "position_setpoints.py")
    assert two.position == (-2.0, 0.0, 0.0) and two.rpy_deg == (0.0, 0.0, 0.0)


def test_an_arena_cannot_be_changed(folder: Path) -> None:
    arena = load(TWO)
    with pytest.raises(dataclasses.FrozenInstanceError):
        arena.name = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="frozen"):
        arena.world.seed = 3


def test_ids_fill_gaps(folder: Path) -> None:
    text = "vehicles:\n" + "".join(
        f"  v{i}: {{start: {{position: [{i - 1.5}, 0, 0]}}{given}}}\n"
        for i, given in enumerate(["", ", id: 1", "", ", id: 7"])
    )
    assert [v.id for v in load(text).vehicles] == [2, 1, 3, 7]


def test_layers_override_in_order_and_keep_their_places(folder: Path) -> None:
    text = (
        "defaults:\n  pose_rate_hz: 90\n  params: {MC_ROLL_P: 7, MC_PITCH_P: 7, MC_YAW_P: 3}\n  start: {rpy_deg: [0, 0, 90]}\n"
        "vehicles:\n  uav1:\n    params: {MC_ROLL_P: 8}\n    start: {position: [1, 0, 0]}\n  uav2: {pose_rate_hz: 60}\n"
    )
    arena = load(text, "vehicles.uav2.params.MC_PITCH_P=9", "mocap.latency_ms=12")
    one, two = arena.vehicles
    assert (one.pose_rate_hz, two.pose_rate_hz) == (90.0, 60.0)
    assert (
        source(arena, "vehicles.uav1.pose_rate_hz") == "arena.yaml:2"
        and source(arena, "vehicles.uav2.pose_rate_hz") == "arena.yaml:9"
    )
    assert (one.own_params["MC_ROLL_P"], one.own_params["MC_PITCH_P"], one.own_params["MC_YAW_P"]) == (
        8.0,
        7.0,
        3.0,
    )
    assert (two.own_params["MC_ROLL_P"], two.own_params["MC_PITCH_P"]) == (7.0, 9.0)
    assert source(arena, "vehicles.uav1.params.MC_ROLL_P") == "arena.yaml:7"
    assert source(arena, "vehicles.uav1.params.MC_PITCH_P") == "arena.yaml:3"
    assert source(arena, "vehicles.uav2.params.MC_PITCH_P") == "--set"
    assert (one.position, one.rpy_deg) == ((1.0, 0.0, 0.0), (0.0, 0.0, 90.0))
    assert source(arena, "vehicles.uav1.start.rpy_deg") == "arena.yaml:4"
    assert source(arena, "vehicles.uav1.start.position") == "arena.yaml:8"
    assert source(arena, "mocap.latency_ms") == "--set" and source(arena, "mocap.rate_hz") == "default"
    assert source(arena, "vehicles.uav1.id").startswith("rule")


@pytest.mark.parametrize(
    ("frames", "poses"),
    [(180, 60), (200, 50), (120, 60), (100, 50), (50, 50), (240, 60), (250, 50), (360, 60)],
)
def test_the_pose_rate_follows_the_frame_rate(frames: float, poses: float, folder: Path) -> None:
    assert load(TWO, f"mocap.rate_hz={frames}").vehicles[0].pose_rate_hz == pytest.approx(poses)


def test_program_is_a_path_or_a_mapping(folder: Path) -> None:
    program = (
        load("vehicles:\n  uav1: {program: {path: fly, args: [a, '1'], restart: on_failure}, args: [b]}\n")
        .vehicles[0]
        .program
    )
    assert program is not None
    assert (Path(program.path).name, program.args, program.restart) == ("fly", ("a", "1", "b"), "on_failure")


def test_a_profile_may_be_a_file_beside_the_arena(folder: Path) -> None:
    from arena.schema import data_folder

    text = (data_folder("profiles") / "iris.yaml").read_text()
    Path("mine.yaml").write_text(
        text.replace("name: iris", "name: mine").replace("mass_kg: 1.52", "mass_kg: 1.9")
    )
    vehicle = load("vehicles: {uav1: {profile: mine.yaml}}").vehicles[0]
    assert (vehicle.profile.name, vehicle.profile.mass_kg) == ("mine", 1.9)
    assert vehicle.profile.hover_command > 0.5652


def test_multicast_group_follows_the_address(folder: Path) -> None:
    assert group(load(TWO, "address=127.70.3.4")) == "239.198.3.4"
    assert group(load(TWO, "address=10.0.0.5")) == "239.255.42.99"
    assert group(load(TWO, "address=127.0.0.2", "mocap.group=239.1.1.1")) == "239.1.1.1"


def test_override_may_add_a_collection(folder: Path) -> None:
    arena = load(
        TWO,
        "tools={rec: {argv: [sleep, '1']}}",
        "vehicles.uav3={start: {position: [2, 1, 0]}}",
        "world.size=[9, 9, 4]",
    )
    assert [v.name for v in arena.vehicles] == ["uav1", "uav2", "uav3"]
    assert arena.tools["rec"].argv == ("sleep", "1") and arena.world.size == (9.0, 9.0, 4.0)


def test_folder_means_its_arena_yaml(folder: Path) -> None:
    load(TWO)
    assert load_arena(folder).vehicles == load_arena(folder / "arena.yaml").vehicles


@pytest.mark.parametrize(
    ("overrides", "backends"),
    [
        ((), ["mavlink", "mavlink"]),
        (("defaults.backend=mavsdk",), ["mavsdk", "mavsdk"]),
        (("defaults.backend=mavsdk", "vehicles.uav2.backend=mavlink"), ["mavsdk", "mavlink"]),
    ],
)
def test_backend_reaches_the_program_of_each_vehicle(
    folder: Path, overrides: tuple[str, ...], backends: list[str]
) -> None:
    slices = make_plan(load(TWO, *overrides)).slices
    assert [slices[f"program.{name}.json"]["backend"] for name in ("uav1", "uav2")] == backends
