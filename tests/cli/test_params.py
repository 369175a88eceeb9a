"""Tests of `arena params` without a running arena: files generated, compared and checked, wrong input refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

import arena.cli as cli
from arena.cli._params import ParamSources, params_file_text
from arena.cli._params_push import new_record
from arena.params.transfer.push_record import PushRecord
from arena.plan.firmware import firmware
from arena.schema import load_arena
from arena.wire.qgc_params import parse_params

YAML = """name: lab
address: 127.52.9.1
failsafe: {offboard_loss: {action: hold, after_s: 0.5}}
landing_speed_m_s: 0.6
vehicles:
  uav1: {params: {MPC_XY_P: 0.9}}
  uav2: {start: {position: [1, 0, 0]}, profile: intel_aero}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arena.yaml").write_text(YAML)
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = cli.main(("params", *arguments))
    output = capsys.readouterr()
    return code, output.out, output.err


@pytest.mark.parametrize("version", ["1.9", "1.13", "1.16", "1.18"])
def test_generated_files_can_be_read_and_give_reasons(
    folder: Path, capsys: pytest.CaptureFixture[str], version: str
) -> None:
    code, out, err = run(capsys, "generate", "--px4-version", version, "-o", "made")
    assert (code, err) == (0, "") and out.split() == ["made/uav1.params", "made/uav2.params"]
    text = (folder / "made" / "uav1.params").read_text()
    values = parse_params(text)
    assert values["MPC_LAND_SPEED"] == 0.6 and values["MPC_XY_P"] == 0.9 and values["MAV_SYS_ID"] == 1
    assert values["COM_OF_LOSS_T"] == (0.0 if version == "1.9" else 0.5)
    assert "landing speed [m/s]; arena.yaml:4\n" in text and "as written; arena.yaml:6\n" in text
    assert ("CA_ROTOR0_PX" in values) == (version != "1.9")
    assert ("NOT POSSIBLE" in text) == (version in ("1.9", "1.13")), (
        "RTL_DESCEND_ALT of old versions is at least 2 m"
    )
    assert parse_params((folder / "made" / "uav2.params").read_text())["MAV_SYS_ID"] == 2


def test_generated_file_has_what_simulated_vehicles_get(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, out, _ = run(capsys, "generate", "--px4-version", "1.16")
    made, flown = (
        parse_params(out.split("# uav2 of")[0]),
        firmware(arena := load_arena("arena.yaml"), arena.vehicles[0]).values,
    )
    assert {k: v for k, v in made.items() if not k.startswith("CA_")} == pytest.approx(flown)


KINDS = """px4: {home: stand-in}
mocap: {source: natnet, server: 127.52.9.2}
vehicles:
  builtin: {autopilot: builtin}
  px4: {autopilot: px4, start: {position: [1, 0, 0]}}
  hardware: {autopilot: hardware, profile: iris, radio: none, url: "udpin:127.52.9.1:14540"}
  hitl: {autopilot: hitl, serial: /dev/ttyACM0, start: {position: [-1, 0, 0]}}
"""


@pytest.mark.parametrize(
    ("name", "has_rotors"), [("builtin", False), ("px4", True), ("hardware", False), ("hitl", True)]
)
def test_rotor_geometry_is_pushed_to_px4_with_a_simulated_body_only(
    folder: Path, name: str, has_rotors: bool
) -> None:
    (folder / "arena.yaml").write_text(KINDS)
    arena = load_arena("arena.yaml")
    vehicle = arena.vehicle(name)
    for version in ("", "1.16"):
        pushed = new_record(arena, [vehicle], None, version).wanted[name]
        compared = ParamSources(Path("arena.yaml"), [], version).read(f"yaml:{name}", "").values
        assert pushed == compared and any(p.startswith("CA_ROTOR") for p in pushed) == has_rotors
        file = parse_params(params_file_text(arena, vehicle, version))
        assert ("CA_ROTOR_COUNT" in file) == (name != "hardware"), (
            "the file has the geometry of a simulated body"
        )
    if name != "px4":  # whose version is unknown here
        assert firmware(arena, vehicle).values == pytest.approx(pushed), (
            "what it starts from, or must hold before it arms"
        )


def test_calibrations_of_a_file_are_not_pushed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "pulled.params").write_text(
        "MAV_SYS_ID 9\nCAL_ACC0_XOFF 0.1\nCAL_GYRO0_ID 4\nLND_FLIGHT_T_LO 77\nRC1_TRIM 1490\nMPC_XY_P 0.9\n"
    )
    arena = load_arena("arena.yaml")
    record = new_record(arena, arena.vehicles, folder / "pulled.params", "")
    assert record.wanted == {"uav1": {"MPC_XY_P": 0.9}, "uav2": {"MPC_XY_P": 0.9}}
    out = capsys.readouterr().out.splitlines()
    assert len(out) == 2 and out[1] == (
        f"uav2: 4 parameters of {folder / 'pulled.params'} are left out, because they are calibrations of one vehicle "
        "or counters: CAL_ACC0_XOFF, CAL_GYRO0_ID, LND_FLIGHT_T_LO, ..."
    )
    (folder / "arena.yaml").write_text(YAML + "defaults: {params_file: pulled.params}\n")
    arena = load_arena("arena.yaml")
    assert "CAL_ACC0_XOFF" not in new_record(arena, arena.vehicles, None, "").wanted["uav2"]
    assert capsys.readouterr().out.count(" 4 parameters of params_file are left out") == 2
    assert (
        "# NOT USED, because they are calibrations of one vehicle or counters: CAL_ACC0_XOFF"
        in run(capsys, "generate")[1]
    )


def test_fault_12_measured_values_are_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = "measured: {MPC_THR_HOVER: {value: 0.42, date: 2026-11-20, how: 30 s of hover}}"
    (folder / "arena.yaml").write_text(KINDS.replace("radio: none,", f"radio: none, {record},"))
    code, out, _ = run(capsys, "measured")
    lines = out.splitlines()
    assert code == 0 and lines[:2] == [
        "hardware: 1 parameters measured",
        "  MPC_THR_HOVER: 0.42, 2026-11-20, 30 s of hover",
    ]
    assert "  EKF2_EV_DELAY (11)" in lines and not any("builtin" in line for line in lines)
    _, out, _ = run(capsys, "generate")
    assert "# NOT SET, because nobody has set or measured it: EKF2_EVP_NOISE, " in out
    assert "# this vehicle's own value; measured 2026-11-20, 30 s of hover (arena.yaml:" in out
    assert "no real vehicle" in run(capsys, "measured", "builtin")[1]


def test_files_are_compared_with_each_other_and_with_the_yaml(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "generate", "-o", "made")
    (folder / "other.params").write_text(
        (folder / "made/uav1.params").read_text().replace("MPC_XY_P\t0.9", "MPC_XY_P\t0.8")
    )
    code, out, _ = run(capsys, "diff", "made/uav1.params", "other.params")
    assert code == 1 and out.split()[-3:] == ["MPC_XY_P", "0.9", "0.8"]
    assert run(capsys, "diff", "yaml:uav1", "made/uav1.params")[:2] == (
        0,
        "yaml:uav1 and made/uav1.params: no difference\n",
    )
    code, out, _ = run(capsys, "diff", "made/uav1.params", "defaults")
    assert code == 1 and "EKF2_EV_CTRL" in out and "SYS_AUTOSTART" not in out


def test_check_passes_generated_parameters_and_finds_wrong_ones(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "check")
    assert code == 0 and " error:" not in out
    (folder / "bad.params").write_text("EKF2_EV_CTRL 0\nCOM_OF_LOSS_T 0.0\nCOM_OBL_RC_ACT 0\n")
    code, out, _ = run(capsys, "check", "bad.params", "--px4-version", "1.16")
    assert code == 1 and "error: EKF2_EV_CTRL" in out and "COM_OBL_RC_ACT" in out


def test_check_takes_the_arena_as_an_argument(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "lab").mkdir()
    (folder / "arena.yaml").rename(folder / "lab" / "arena.yaml")
    for arena in ("lab/arena.yaml", "lab"):
        code, out, err = run(capsys, "check", arena)
        assert (code, err) == (0, "") and "yaml:uav1: " in out and "yaml:uav2: " in out
    (folder / "bad.params").write_text("EKF2_EV_DELAY 100\n")
    code, out, _ = run(capsys, "check", "lab/arena.yaml", "bad.params", "yaml:uav2")
    assert code == 0 and "from the arena's latency" in out and "yaml:uav1" not in out
    code, _, err = run(capsys, "check", "lab/arena.yaml", "uav1")
    assert code == 2 and "uav1 is simulated, but no arena is running on 127.52.9.1" in err
    code, _, err = run(capsys, "check", "lab", "other.yaml")
    assert code == 2 and "got 2 YAML files or folders (lab, other.yaml), expected one" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("push",),
            "uav1 is simulated, but no arena is running on 127.52.9.1. Start the arena with `arena up`",
        ),
        (("push", "uav7"), "got vehicle uav7, expected one of uav1, uav2"),
        (("push", "--resume"), "push.json: No such file or directory: there is no push to resume"),
        (("push", "--file", "none.params"), "none.params"),
        (("push", "--file", "range.params"), "MPC_XY_P: got 99, expected from 0 to 2"),
        (("push", "--file", "range.params"), "COM_OBL_RC_ACT: got 1.5, expected an integer"),
        (("push", "--file", "huge.params"), "huge.params:1: MPC_Z_P: 1e999 is not a value for a parameter"),
        (("pull",), "no arena is running"),
        (
            ("diff", "nowhere", "uav1"),
            "got 'nowhere', expected a vehicle (uav1, uav2), whose parameters are then read, `yaml:VEHICLE`",
        ),
        (("diff", "yaml:uav9", "defaults"), "got vehicle uav9"),
        (("check", "torn.params"), "torn.params:2"),
        (("generate", "--px4-version", "1.8"), "PX4 1.8 is not in the table"),
        (("generate", "--px4-version", "soon"), "'soon' is not a PX4 version"),
        (("generate", "none.yaml"), "none.yaml: cannot be read"),
    ],
)
def test_wrong_input_is_refused_without_a_traceback(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    (folder / "range.params").write_text("MPC_XY_P 99\nCOM_OBL_RC_ACT 1.5\n")
    (folder / "huge.params").write_text("MPC_Z_P 1e999\n")
    (folder / "torn.params").write_text("MPC_XY_P 0.9\nMPC_Z_P\n")
    code, _, err = run(capsys, *arguments)
    assert code == 2 and words in err and "Traceback" not in err, err


def test_interrupted_push_is_resumed_to_the_same_vehicles_only(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = PushRecord.begin(
        folder / "push.json", {"uav1": {"MPC_XY_P": 0.9}}, {"uav1": "id 1, simulated on 127.0.0.9"}
    )
    record.update("uav1", {"MPC_XY_P": 0.95}, {"MPC_XY_P": 0.9}, "interrupted")
    record.save()
    kept = (folder / "push.json").read_text()
    for arguments, words in (
        (
            (),
            "an earlier push was interrupted, or a vehicle has not acknowledged all of its values. Continue it with --resume",
        ),
        (
            ("--resume",),
            "the interrupted push was to uav1 at id 1, simulated on 127.0.0.9, "
            "but this arena has uav1 at id 1, simulated on 127.52.9.1",
        ),
        (("--resume", "uav2"), "the interrupted push has none of the chosen vehicles. Choose from uav1"),
        (("--resume", "--file", "x"), "Remove --file"),
    ):
        code, _, err = run(capsys, "push", *arguments)
        assert code == 2 and words in err, err
    assert (folder / "push.json").read_text() == kept, "the record keeps the old values"


def test_check_reads_the_version_of_a_generated_file(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "generate", "--px4-version", "1.9", "-o", "made")
    code, out, _ = run(capsys, "check", "made/uav1.params")
    assert code == 0 and " error:" not in out, out


def test_folder_that_cannot_be_written_is_an_error(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "made").touch()
    code, _, err = run(capsys, "generate", "-o", "made")
    assert code == 2 and err == "arena: made: File exists\n"


def test_battery_thresholds_outside_px4s_limits_are_moved(
    folder: Path, runtime_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "arena.yaml").write_text(
        "failsafe: {low_battery: {warn: 0.9, land: 0.02}}\nvehicles: {uav1: {}}\n"
    )
    _, out, _ = run(capsys, "generate")
    assert out.count("NOT POSSIBLE: failsafe.low_battery") == 2
    assert run(capsys, "push", "--dry-run")[0] == 2  # no arena is running; the limits are not the reason
    assert "nothing was pushed" not in run(capsys, "push", "--dry-run")[2]


def test_help_lists_the_five_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--help")
    assert code == 0 and all(name in out for name in ("generate", "push", "pull", "diff", "check"))
    assert isinstance(cli.build(["params"]), typer.Typer)
