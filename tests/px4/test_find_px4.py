"""Search for PX4: places and their order, what counts as a PX4, its version."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError, NotInstalledError
from arena.plan import make_plan
from arena.plan.firmware import firmware, origins
from arena.schema import load_arena
from arena.schema.px4 import WAYS, find_px4, need_px4, version_of


def build(folder: Path, version: str = "1.16.0", where: str = "build/px4_sitl_default") -> Path:
    """Make a folder like PX4's build folder, with a file as its binary."""
    binary = folder / where / "bin" / "px4"
    binary.parent.mkdir(parents=True)
    binary.write_bytes(b"\x7fELF\0\0v12345\0" + f"v{version}\0".encode() + b"\0v9.9.9\0")
    binary.chmod(0o755)
    rcs = folder / where / "etc" / "init.d-posix" / "rcS"
    rcs.parent.mkdir(parents=True)
    rcs.touch()
    return folder


@pytest.mark.parametrize("where", ["", "build/px4_sitl_default", "build/px4_sitl"])
def test_source_build_and_installation_folders_are_found(tmp_path: Path, where: str) -> None:
    found = find_px4(str(build(tmp_path / "PX4", where=where)), {})
    assert found is not None and found.version == "1.16.0" and found.source == "px4.home of the YAML"
    assert found.argv == (str(tmp_path / "PX4" / where / "bin" / "px4"),)
    assert found.data == str(tmp_path / "PX4" / where / "etc") and not found.stand_in


def test_search_order_is_yaml_environment_path(tmp_path: Path) -> None:
    home, env, path = (
        build(tmp_path / name, version)
        for name, version in (("a", "1.16.0"), ("b", "1.15.4"), ("c", "1.17.0"))
    )
    everything = {"PX4_HOME": str(env), "PATH": str(path / "build" / "px4_sitl_default" / "bin")}

    def version(home: Path | None, env: dict[str, str]) -> str:
        found = find_px4(str(home) if home else None, env)
        return found.version if found else ""

    assert version(home, everything) == "1.16.0"
    assert version(None, everything) == "1.15.4"
    assert version(None, {"PATH": everything["PATH"]}) == "1.17.0"
    assert version(None, {"PATH": str(tmp_path)}) == ""


def test_a_home_in_the_yaml_is_the_only_place_searched(tmp_path: Path) -> None:
    other = build(tmp_path / "other")
    assert find_px4(str(tmp_path / "empty"), {"PX4_HOME": str(other)}) is None


def test_a_binary_without_startup_scripts_is_not_px4(tmp_path: Path) -> None:
    first = build(tmp_path / "a")
    (first / "build/px4_sitl_default/bin/px4").chmod(0o644)
    second = build(tmp_path / "b")
    (second / "build/px4_sitl_default/etc/init.d-posix/rcS").unlink()
    assert find_px4(str(first), {}) is None and find_px4(str(second), {}) is None


@pytest.mark.parametrize(
    ("content", "version"),
    [
        (b"..\0v1.16.0\0..", "1.16.0"),
        (b"\0v1.17.0-beta1\0", "1.17.0-beta1"),
        (b"\0v1.16.0-2-g0123abc\0", "1.16.0-2-g0123abc"),
        (b"\0v1.6.10-100-g890c415\0\0v1.8.2-beta4\0\0v1.16.0\0", "1.16.0"),
        (b"version v1.16.0 of\0", ""),
        (b"\0v2.0.0\0", ""),
        (b"", ""),
    ],
)
def test_version_is_read_from_the_binary(tmp_path: Path, content: bytes, version: str) -> None:
    (tmp_path / "px4").write_bytes(content)
    assert version_of(tmp_path / "px4") == version


def test_a_missing_binary_has_no_version(tmp_path: Path) -> None:
    assert version_of(tmp_path / "px4") == ""


def test_error_for_missing_px4_lists_places_and_ways(tmp_path: Path) -> None:
    with pytest.raises(NotInstalledError) as error:
        need_px4(None, {"PX4_HOME": str(tmp_path), "PATH": ""})
    assert f"$PX4_HOME ({tmp_path})" in str(error.value) and error.value.exit_code == 2
    assert all(way in str(error.value) for way in WAYS)


def arena_file(folder: Path, more: str) -> Path:
    file = folder / "arena.yaml"
    file.write_text(f"vehicles: {{uav1: {{autopilot: px4}}}}\n{more}")
    return file


def test_home_stand_in_selects_the_stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named = load_arena(arena_file(tmp_path, "px4: {home: stand-in}\n")).px4
    assert named is not None and named.stand_in and named.argv[1:] == ("-m", "arena.autopilot.sitl_standin")
    monkeypatch.setenv("PX4_HOME", "stand-in")
    found = load_arena(arena_file(tmp_path, "")).px4
    assert found is not None and found.stand_in and found.source == "$PX4_HOME" and "stand-in" in found.words


def test_a_relative_home_is_relative_to_the_yaml(tmp_path: Path) -> None:
    build(tmp_path / "PX4")
    found = load_arena(arena_file(tmp_path, "px4: {home: ./PX4}\n")).px4
    assert found is not None and found.version == "1.16.0"


@pytest.mark.parametrize(
    ("binary", "names"), [("1.14.3", "1.14.3"), ("1.16.0-2-g0123abc", "1.16"), ("1.99.0", "1.16")]
)
def test_parameters_have_the_names_of_the_flown_px4_version(tmp_path: Path, binary: str, names: str) -> None:
    build(tmp_path / "PX4", binary)
    arena = load_arena(arena_file(tmp_path, "px4: {home: ./PX4}\ndefaults: {px4_version: '1.13'}\n"))
    assert firmware(arena, arena.vehicles[0]).version == names
    origin = origins(arena)["vehicles.uav1.px4_version"]
    assert (origin.value, origin.source) == (names, f"rule: PX4 {binary}")


def test_a_home_without_px4_is_an_error_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"arena.yaml:2: px4.home: got \./PX4, which contains no PX4"
    ) as error:
        load_arena(arena_file(tmp_path, "px4: {home: ./PX4}\n"))
    assert "arena doctor" in str(error.value)


def test_the_resolved_arena_flies_the_same_px4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PX4_HOME", str(build(tmp_path / "PX4")))
    plan = make_plan(load_arena(arena_file(tmp_path, "")))
    monkeypatch.delenv("PX4_HOME")
    again = tmp_path / "run" / "arena.yaml"
    again.parent.mkdir()
    again.write_text(plan.yaml)
    assert make_plan(load_arena(again)).slices["px4.uav1.json"] == plan.slices["px4.uav1.json"]


def test_real_px4_links_are_at_127_0_0_1_on_any_loopback_address(
    tmp_path: Path,
) -> None:
    build(tmp_path / "PX4")
    for home, host in (("./PX4", "127.0.0.1"), ("stand-in", "127.60.0.9")):
        plan = make_plan(load_arena(arena_file(tmp_path, f"address: 127.60.0.9\npx4: {{home: {home}}}\n")))
        router, forward = (
            plan.slices["router.json"]["vehicles"][0]["link"],
            plan.slices["forward.uav1.json"]["link"],
        )
        assert (router["local"], router["remote"]) == (["127.60.0.9", 24011], [host, 24010])
        assert (forward["local"], forward["remote"]) == (["127.60.0.9", 24013], [host, 24012])
        assert (
            plan.vehicles[0].panic.autopilot_host == host
            and plan.vehicles[0].panic.partner_host == "127.60.0.9"
        )
        assert "-u 24010 -t 127.60.0.9 -o 24011" in plan.slices["px4.uav1.json"]["scripts"]["px4-rc.mavlink"]


def test_build_without_lockstep_is_not_searched(tmp_path: Path) -> None:
    assert find_px4(str(build(tmp_path / "PX4", where="build/px4_sitl_nolockstep")), {}) is None
