"""The verbs that start nothing (init, check, plan, schema), and help, errors and exit codes of every verb."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import typer.main

import arena.cli as cli
from arena.cli import _checking
from arena.errors import RunError
from arena.schema import load_arena
from arena.schema.base import Strict


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hover.py").touch()
    (tmp_path / "arena.yaml").write_text(
        "name: lab\naddress: 127.52.2.1\nvehicles:\n  uav1: {program: hover.py}\n"
    )
    return tmp_path


HEAVY = ("pydantic", "numpy", "pymavlink", "yaml", "matplotlib", "jinja2")


def imported(code: str, *modules: str) -> list[str]:
    """Return those of `modules` that a new Python process has imported after running `code`."""
    last = f"\nimport sys; print([m for m in {modules!r} if m in sys.modules], file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code + last], check=True, capture_output=True, text=True, timeout=60
    )
    found: list[str] = ast.literal_eval(done.stderr.splitlines()[-1])
    return found


def run(*arguments: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = cli.main(arguments)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_check_says_ok_and_what_would_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run("check", capsys=capsys)
    assert (code, err) == (0, "") and out.startswith("ok: lab (arena.yaml)")
    assert (
        "uav1: id 1, iris, autopilot builtin (auto: no PX4 was found), at N 0 E 0 D 0, port 16001, hover.py"
        in out
    )
    assert "6 processes, 1 of them user programs" in out


def test_check_names_parameters_that_the_builtin_autopilot_does_not_use(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "other.params").write_text("1\t1\tSENS_BOARD_ROT\t0\t6\n1\t1\tMPC_XY_P\t0.9\t9\n")
    written = "vehicles.uav1.params={MC_AIRMODE: 1, MPC_XY_P: 0.8, EKF2_HGT_REF: 1, SENS_EN_SF1XX: 2}"
    _, out, _ = run(
        "check", "--set", written, "--set", "vehicles.uav1.params_file=other.params", capsys=capsys
    )
    assert "uav1: MC_AIRMODE has no effect (--set): the built-in autopilot does not use MC_AIRMODE: " in out
    assert "uav1: SENS_EN_SF1XX has no effect (--set): the built-in autopilot has no SENS_EN_SF1XX" in out
    assert "uav1: 1 parameters of its params_file have no effect" in out
    assert "MPC_XY_P has no effect" not in out and "EKF2_HGT_REF has no effect" not in out
    assert "has no effect" not in run("check", capsys=capsys)[1]


@pytest.mark.parametrize(
    "arguments",
    [
        "",
        "arena.yaml",
        ".",
        "--no-machine --set name=other",
        "--set=name=other arena.yaml --machine --no-machine --set mocap.rate_hz=120",
        "none.yaml",
        "--set wind=1",
        "--set=",
        "--set",
        "arena.yaml other.yaml",
        "--set -1",
        "-- arena.yaml",
        "-- -1",
        "--set name=other -- arena.yaml",
        "--machine=1",
        "--mach",
        "-",
        "--help",
        "arena.yaml -h",
        "--version",
    ],
)
def test_plain_check_does_the_same_without_typer(
    arguments: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = run("check", *arguments.split(), capsys=capsys)
    monkeypatch.setattr(_checking, "plain_options", lambda _: None)
    assert run("check", *arguments.split(), capsys=capsys) == plain


def test_plain_check_imports_neither_typer_nor_the_search_for_plugins(folder: Path) -> None:
    command = (
        f"import os; os.chdir({str(folder)!r})\nfrom arena.cli import main; main(['check', '--no-machine'])"
    )
    assert imported(command, "typer", "click", "numpy", "pydantic.plugin._loader") == []
    searched = f"{command}\nfrom pydantic.plugin import _loader; _loader.entry_points"  # the real module, if it is needed
    assert imported(searched, "pydantic.plugin._loader") == ["pydantic.plugin._loader"]


def test_check_prints_all_problems_and_exits_with_2(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run("check", "--set", "mocap.latency_ms=1", "--set", "vehicles.uav1.id=0", capsys=capsys)
    assert (code, out) == (2, "") and len(err.splitlines()) == 2 and "Traceback" not in err


def test_single_problem_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run("check", "none.yaml", capsys=capsys)
    assert code == 2 and err == "arena: none.yaml: cannot be read: No such file or directory\n"


def test_plan_prints_each_process_with_its_needs_ports_and_command(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run("plan", capsys=capsys)
    assert code == 0
    line = next(x for x in out.splitlines() if "program.uav1" in x and "--uav" in x)
    for word in ("forward.uav1, router, recorder", "started", "16001", "{run}/slices/program.uav1.json"):
        assert word in line


def test_plan_as_json_is_the_plan(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from arena.plan import Plan, make_plan

    code, out, _ = run("plan", "--json", "--set", "mocap.rate_hz=120", capsys=capsys)
    assert code == 0 and Plan.from_json(out) == make_plan(load_arena("arena.yaml", ["mocap.rate_hz=120"]))


def test_explain_prints_the_source_of_a_value(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def told(key: str, *more: str) -> str:
        return run("plan", "--explain", key, *more, capsys=capsys)[1]

    assert told("name") == 'name = "lab" from arena.yaml:1\n'
    assert told("mocap.rate_hz") == "mocap.rate_hz = 180.0 (default)\n"
    assert told("mocap.rate_hz", "--set", "mocap.rate_hz=120") == "mocap.rate_hz = 120.0 from --set\n"
    assert told("vehicles.uav1.params.MC_ROLL_P") == "vehicles.uav1.params.MC_ROLL_P = 6.0 (profile iris)\n"
    assert len(told("vehicles.uav1.start").splitlines()) == 3
    code, _, err = run("plan", "--explain", "mocap.rate", capsys=capsys)
    assert code == 2 and "Did you mean mocap.rate_hz?" in err


def test_schema_has_every_key_and_accepts_a_path_as_program(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, out, _ = run("schema", capsys=capsys)
    schema = json.loads(out)
    sections = {"name", "world", "sim", "mocap", "failsafe", "geofence", "hosts", "tools", "vehicles"}
    assert code == 0 and set(schema["properties"]) >= sections
    vehicle = schema["$defs"]["VehicleKeys"]
    assert (
        vehicle["additionalProperties"] is False
        and {"type": "string"} in vehicle["properties"]["program"]["anyOf"]
    )
    undescribed = [
        f"{n}.{k}"
        for n, d in schema["$defs"].items()
        for k, v in d["properties"].items()
        if "description" not in v
    ]
    assert undescribed == []


def test_init_makes_an_arena_that_checks_and_a_program_of_ten_lines(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("lab1", "1e3", "deep/no"):
        code, out, _ = run("init", name, capsys=capsys)
        assert code == 0 and f"{name}/arena.yaml" in out
        made = load_arena(Path(name))
        assert made.name == Path(name).name and made.vehicles[0].program is not None
        program = Path(name, "hover.py").read_text()
        assert len(program.splitlines()) <= 10 and program.endswith("\n")
        compile(program, "hover.py", "exec")
        assert (Path(name) / "README.md").read_text().startswith(f"# {Path(name).name}\n")


def test_init_overwrites_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("lab1").mkdir()
    Path("lab1/hover.py").write_text("mine")
    code, _, err = run("init", "lab1", capsys=capsys)
    assert code == 2 and "lab1/hover.py" in err and [p.name for p in Path("lab1").iterdir()] == ["hover.py"]
    assert Path("lab1/hover.py").read_text() == "mine"
    assert run("init", "a b", capsys=capsys)[0] == 2 and run("init", "arena.yaml/x", capsys=capsys)[0] == 2


def failing(error: BaseException) -> typer.Typer:
    app = typer.Typer()

    @app.callback()
    def _group() -> None: ...

    @app.command()
    def plan() -> None:
        raise error

    return app


@pytest.mark.parametrize(
    ("error", "code"), [(RunError("it broke"), 1), (KeyboardInterrupt(), 130), (ZeroDivisionError("x"), 1)]
)
def test_failure_is_one_line_and_an_exit_code(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "build", lambda _: failing(error))
    monkeypatch.setattr(_checking, "check", Mock(side_effect=error))
    for verb in ("plan", "check"):  # with typer, and a plain command line without it
        got, _, err = run(verb, capsys=capsys)
        assert got == code and "Traceback" not in err
        assert err == {1: "arena: it broke\n", 130: ""}.get(code, "") or "bug in arena" in err
        if not isinstance(error, KeyboardInterrupt):
            with pytest.raises(type(error)):
                cli.main(["--debug", verb])


def test_wrong_command_line_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("chekc", capsys=capsys)[0] == 2 and run("check", "--nope", capsys=capsys)[0] == 2
    assert run("--help", capsys=capsys)[0] == 0


def test_debug_after_a_double_dash_is_the_verbs() -> None:
    arguments = ["logs", "--", "--debug"]
    assert not cli._take_debug(arguments) and arguments[-1] == "--debug"
    assert cli._take_debug(arguments := ["check", "--debug"]) and arguments == ["check"]


def test_land_all_starts_without_the_heavy_modules() -> None:
    assert imported("from arena.cli import build; build(['land-all'])", *HEAVY, "rich.table") == []


def test_list_of_verbs_is_printed_without_their_modules() -> None:
    assert (
        imported("from arena.cli import main; main(['--help'])", *HEAVY, "arena.schema", "arena.plan") == []
    )


def test_help_does_not_import_rich() -> None:
    assert imported("from arena.cli import main; main(['check', '--help'])", "rich.console") == []


def test_up_imports_neither_rich_nor_the_page_before_it_needs_them() -> None:
    assert imported("import arena.cli.up", "rich.console", "arena.monitor.server", "numpy") == []


def test_commands_to_a_running_arena_do_not_import_the_schema() -> None:
    """One interpreter imports all these commands: if it has none of the heavy modules, no command imports one."""
    verbs = ("ps", "down", "restart", "release", "arm_permit", "preflight", "log", "kill_all", "top")
    code = "\n".join(f"import arena.cli.{verb}" for verb in verbs)
    code += "\nfrom arena.supervisor import Supervisor, open_run"
    assert imported(code, *HEAVY, "arena.schema", "rich") == []


def test_check_imports_neither_the_supervisor_loop_nor_numpy_nor_rich(folder: Path) -> None:
    code = "from arena.cli import main; assert main(['check']) == 0"
    heavy = ("numpy", "pymavlink", "rich.console", "matplotlib", "psutil", "arena.supervisor.loop")
    assert imported(code, *heavy) == []


def test_check_of_obstacles_does_not_import_numpy(tmp_path: Path) -> None:
    file = tmp_path / "arena.yaml"
    pole = "{shape: cylinder, size: [0.2, 2.0], position: [1.0, 0.0, 0.0], rpy_deg: [10, 0, 0]}"
    file.write_text(f"vehicles: {{uav1: {{}}}}\nworld: {{obstacles: {{pole: {pole}}}}}\n")
    code = f"from arena.cli import main; assert main(['check', {str(file)!r}]) == 0"
    assert imported(code, "numpy") == []


def test_check_reads_no_source_of_models(folder: Path) -> None:
    code = "from arena.cli import main; assert main(['check']) == 0"
    assert imported(code, "arena.schema.descriptions") == []
    assert not Strict.model_config.get("use_attribute_docstrings")


def test_list_of_verbs_equals_the_docstrings_of_the_verbs() -> None:
    def listed(app: typer.Typer) -> list[tuple[str, str]]:
        commands: Any = typer.main.get_command(app)
        first = {name: each.help.partition("\n\n")[0] for name, each in commands.commands.items()}
        return [(name, " ".join(text.split())) for name, text in first.items()]

    assert listed(cli.build(())) == listed(cli.build_complete())


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_has_help_and_refuses_an_unknown_option(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(verb, "--help", capsys=capsys)
    assert code == 0 and f"arena {verb}" in out
    code, out, err = run(verb, "--no-such-option", capsys=capsys)
    assert code == 2 and "no-such-option" in out + err and "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("ps",), 1, "no arena is running"),
        (("down",), 1, "no arena is running"),
        (("restart", "router"), 1, "no arena is running"),
        (("logs", "router"), 1, "no arena is running"),
        (("ps", "--run", "nowhere"), 2, "nowhere: no arena is running from this folder"),
        (("logs", "router", "--run", "nowhere"), 2, "no log of 'router'"),
        (("check", "none.yaml"), 2, "none.yaml: cannot be read"),
        (("plan", "none.yaml"), 2, "none.yaml: cannot be read"),
        (("up", "none.yaml"), 2, "none.yaml: cannot be read"),
        (("up", "-q", "-v"), 2, "got both -q and -v"),
        (("smoke", "none.smoke.yaml"), 2, "none.smoke.yaml"),
        (("params", "generate", "none.yaml"), 2, "none.yaml: cannot be read"),
        (("summary", "nowhere"), 2, "nowhere: not a run folder"),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, tuple) else "",
)
def test_wrong_call_of_a_verb_is_one_line_and_an_exit_code(
    arguments: tuple[str, ...],
    code: int,
    message: str,
    folder: Path,
    runtime_dir: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    got, _, err = run(*arguments, capsys=capsys)
    assert (got, len(err.splitlines())) == (code, 1) and message in err


def ended_run(folder: Path, name: str) -> Path:
    made = folder / "runs" / name
    (made / "logs").mkdir(parents=True)
    (made / "plan.json").write_text("{}")
    (made / "logs" / "router.log").write_text(f"log of {name}\n")
    return made


def test_logs_of_the_last_ended_run_of_this_folder_are_printed(
    folder: Path, runtime_dir: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    ended_run(folder, "20260101-000000-a")
    last = ended_run(folder, "20260102-000000-a")
    for arguments in (("logs", "router"), ("logs", "router", "--run", str(folder))):
        assert cli.main(list(arguments)) in (0, None)
        out, err = capfd.readouterr()
        assert out == f"log of {last.name}\n"
        assert ("no arena is running; log of the last run" in err) is ("--run" not in arguments)


def test_commands_for_a_run_take_the_last_run_of_an_arena(
    folder: Path, runtime_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    last = ended_run(folder, "20260102-000000-a")
    code, _, err = run("summary", str(folder), capsys=capsys)
    assert code == 2 and f"{last}: this run has no report" in err
    (folder / "empty" / "runs").mkdir(parents=True)
    code, _, err = run("summary", str(folder / "empty"), capsys=capsys)
    assert code == 2 and "contains no run folders" in err


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    from arena import __version__

    assert run("--version", capsys=capsys) == (0, f"arena {__version__}\n", "")


def test_init_writes_a_gitignore_for_what_flights_write(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("init", "lab2", capsys=capsys)[0] == 0
    assert {"runs/", "results/"} <= set(Path("lab2/.gitignore").read_text().splitlines())
