"""Nothing real may arm before a person has said so."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from arena.cli._consent import ask_consent
from arena.errors import InputError
from arena.plan import Plan, make_plan
from arena.schema import load_arena

REAL = """
mocap: {source: natnet, server: 10.0.0.5}
vehicles:
  uav1: {autopilot: builtin}
  uav2: {id: 9, autopilot: hardware, profile: iris, radio: none, url: "udpin:127.75.0.1:14540", program: fly.py}
"""


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def plan(tmp_path: Path) -> Iterator[Plan]:
    (tmp_path / "fly.py").touch()
    (tmp_path / "arena.yaml").write_text(REAL)
    yield make_plan(load_arena(tmp_path / "arena.yaml"))


def test_consent_lists_real_vehicles_and_accepts_yes(
    plan: Plan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("yes\n"))
    ask_consent(plan, yes=False)
    told = capsys.readouterr().out
    assert (
        "1 real vehicle:" in told and "uav2: system id 9" in told and "fly.py" in told and "uav1" not in told
    )


@pytest.mark.parametrize("answer", ["", "\n", "y\n", "no\n", "YES please\n"])
def test_any_other_answer_starts_nothing(answer: str, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Terminal(answer))
    with pytest.raises(InputError, match="Nothing was started"):
        ask_consent(plan, yes=False)


@pytest.mark.parametrize("yes", [False, True])
def test_fault_1_consent_repeats_that_there_is_no_radio(
    yes: bool, plan: Plan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("yes\n"))
    ask_consent(plan, yes=yes)
    assert (
        "uav2 has no pilot with an RC transmitter: nobody can take manual control\n"
        in capsys.readouterr().out
    )


def test_consent_says_nothing_of_a_radio_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fly.py").touch()
    (tmp_path / "arena.yaml").write_text(REAL.replace(" radio: none,", ""))
    monkeypatch.setattr("sys.stdin", Terminal("yes\n"))
    ask_consent(make_plan(load_arena(tmp_path / "arena.yaml")), yes=False)
    assert "RC transmitter" not in capsys.readouterr().out


def test_a_simulated_arena_asks_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arena.yaml").write_text("vehicles: {uav1: {autopilot: builtin}}\n")
    monkeypatch.setattr("sys.stdin", Terminal("no\n"))
    ask_consent(make_plan(load_arena(tmp_path / "arena.yaml")), yes=False)


@pytest.mark.parametrize("options", [(), ("--json",), ("-q",)])
def test_up_without_terminal_and_yes_starts_nothing(
    options: tuple[str, ...], plan: Plan, tmp_path: Path, runtime_dir: Path
) -> None:
    argv = [
        sys.executable,
        "-m",
        "arena",
        "up",
        str(tmp_path),
        "--headless",
        "--runs",
        str(tmp_path / "runs"),
        *options,
    ]
    done = subprocess.run(
        argv, check=False, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2 and "stdin is not a terminal" in done.stderr and "--yes" in done.stderr
    listed = "1 real vehicle:"
    assert (listed in done.stderr, listed in done.stdout) == (bool(options), not options)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("keys", "repeated"), [("", False), ("preflight: {axes_check: none}", True)])
def test_consent_repeats_that_there_is_no_axes_check(
    keys: str,
    repeated: bool,
    plan: Plan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # review fault 2
    (tmp_path / "arena.yaml").write_text(f"{REAL}{keys}\n")
    monkeypatch.setattr("sys.stdin", Terminal("yes\n"))
    ask_consent(make_plan(load_arena(tmp_path / "arena.yaml")), yes=False)
    assert ("uav2 can arm without the identity and axes check" in capsys.readouterr().out) is repeated
