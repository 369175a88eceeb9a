"""Tests that every shell, YAML and Python block of the pages is valid in this version."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from arena import UAV
from arena.campaign import preparation
from arena.campaign.design import Flight, flights
from arena.campaign.sweep import load_sweep
from arena.cli import build, main
from arena.schema import load_arena
from arena.smoke.language.scenario import Scenario, load_scenarios
from arena.uav import data_groups

from .pages import ROOT, Block, blocks

_HARMLESS = {"init", "check", "plan", "schema"}
SHELL, YAML, PYTHON = blocks("sh", "bash", "shell"), blocks("yaml"), blocks("python")


def lines(block: Block) -> list[list[str]]:
    """Return the command lines of a shell block as lists of words, without comments."""
    return [words for line in block.text.splitlines() if (words := shlex.split(line, comments=True))]


ARENA_LINES = [(block, words[1:]) for block in SHELL for words in lines(block) if words[0] == "arena"]


def test_pages_contain_blocks_of_each_kind():
    assert len(SHELL) > 10 and len(YAML) > 8 and len(PYTHON) > 6 and len(ARENA_LINES) > 20


# -- shell -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", SHELL, ids=str)
def test_shell_blocks_use_known_commands(block):
    for words in lines(block):
        assert words[0] in ("arena", "jupyter", "make", "pip", "python", "ray"), words
        if words[0] == "make":
            targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M))
            assert {w for w in words[1:] if "=" not in w} <= targets, words


@pytest.mark.parametrize("words", [w for _, w in ARENA_LINES], ids=" ".join)
def test_arena_lines_are_accepted_by_the_command(words):
    assert parsed(words).command.name == words[0]


class NotTakenError(Exception):
    """Raised for a verb, option or argument that does not exist."""


def parsed(words: list[str]) -> Any:
    """Parse a command line with the real command without running it."""
    command: Any = typer.main.get_command(build(words))
    context = command.make_context("arena", list(words))
    verb = command.get_command(context, words[0])
    try:
        return verb.make_context(words[0], list(words[1:]), parent=context)
    except Exception as error:  # typer's own, or click's: that depends on its version
        raise NotTakenError(f"arena {shlex.join(words)}: {error}") from error


@pytest.mark.parametrize(
    "line", ["upp", "up --headles", "logs", "plan a.yaml b.yaml", "up --time-limit soon", "land-all --only"]
)
def test_invalid_arena_line_is_detected(line):
    with pytest.raises(NotTakenError):
        parsed(line.split())


@pytest.mark.parametrize("words", [w for _, w in ARENA_LINES if w[0] in _HARMLESS], ids=" ".join)
def test_harmless_lines_run(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lab(tmp_path)
    if "lab1" in words[1:] and words[0] != "init":
        assert main(["init", "lab1"]) == 0
    if (
        words[0] == "check" and "--no-machine" not in words
    ):  # whose ports are free here is no matter of the page
        words = [*words, "--no-machine"]
    assert main(words) == 0, capsys.readouterr()


def lab(folder: Path) -> None:
    """Make a folder with the examples and an arena of three vehicles, for lines that can be run."""
    (folder / "examples").symlink_to(ROOT / "examples")
    (folder / "hover.py").write_text("")
    (folder / "arena.yaml").write_text(
        "vehicles:\n"
        "  uav1: {start: {position: [1, 0, 0]}, program: hover.py}\n"
        "  uav2: {start: {position: [-1, 0, 0]}}\n"
        "  uav3: {start: {position: [-1, 1.2, 0]}, id: 7}\n"
    )


# -- YAML --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", YAML, ids=str)
def test_yaml_blocks_are_valid(block, tmp_path):
    found = yaml.safe_load(block.text)
    if "steps" in found:
        assert scenarios_of(block.text, found, tmp_path)
        return
    if "vary" in found:
        assert flights_of(block.text, found, tmp_path)
        return
    if "jobs" in found:
        for step in found["jobs"]["fly"]["steps"]:
            words = shlex.split(step.get("run", ""))
            assert not words or words[0] == "pip" or parsed(words[1:]).command.name == words[1]
        return
    text = block.text if "vehicles" in found else f"{block.text}\nvehicles:\n  uav1: {{}}\n"
    stub(found, tmp_path)
    (tmp_path / "lab1").mkdir(exist_ok=True)
    (tmp_path / "lab1" / "arena.yaml").write_text(text)
    assert load_arena(tmp_path / "lab1" / "arena.yaml").vehicles


def scenarios_of(text: str, found: dict, folder: Path) -> list[Scenario]:
    """Parse a block as a scenario, in an arena with the vehicle names that it uses."""
    for name in [found["arena"]] if isinstance(found["arena"], str) else found["arena"]:
        (folder / name).write_text(
            "vehicles:\n  uav1: {program: fly.py}\n  uav2: {program: fly.py, start: {position: [2, 0, 0]}}\n"
        )
    (folder / "fly.py").touch()
    (folder / "scenario.yaml").write_text(text)
    return load_scenarios(folder / "scenario.yaml")


def flights_of(text: str, found: dict, folder: Path) -> list[Flight]:
    """Parse a block as a sweep file, and check every flight of it in an arena with one vehicle."""
    arena = folder / found["arena"]
    arena.parent.mkdir(parents=True, exist_ok=True)
    arena.write_text("vehicles:\n  uav1: {autopilot: builtin, program: fly.py}\n")
    (arena.parent / "fly.py").touch()
    (folder / "sweep.yaml").write_text(text)
    sweep = load_sweep(folder / "sweep.yaml")
    made = flights(sweep)
    preparation.check(sweep, made)
    return made


def stub(found: object, folder: Path) -> None:
    """Make the files that a block names: empty programs, a profile, a folder that looks like a PX4."""
    for name in re.findall(r"[\w./]+\.(?:py|yaml)\b", str(found)):
        path = folder / "lab1" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text((ROOT / "profiles" / "iris.yaml").read_text() if name.endswith(".yaml") else "")
    vehicles = found.get("vehicles", {}).values() if isinstance(found, dict) else ()
    programs = [v["program"] for v in vehicles if v and "program" in v]
    for path in {p["path"] if isinstance(p, dict) else p for p in programs}:
        if not path.endswith(".py"):
            (folder / "lab1").mkdir(exist_ok=True)
            (folder / "lab1" / path).touch(0o755)
    if isinstance(found, dict) and "px4" in found:
        px4 = folder / "lab1" / found["px4"]["home"]
        for name in ("bin/px4", "etc/init.d-posix/rcS"):
            (px4 / name).parent.mkdir(parents=True)
            (px4 / name).touch(0o755)


def test_readme_arena_is_the_first_example():
    first = next(b for b in YAML if b.page.name == "README.md")
    assert yaml.safe_load(first.text) == yaml.safe_load(
        (ROOT / "examples/01_two_quads/arena.yaml").read_text()
    )


# -- Python ------------------------------------------------------------------------------------------------------------

# Data group of `uav` -> its class.
GROUPS = {
    "ekf": data_groups.Ekf,
    "sen": data_groups.Sensors,
    "act": data_groups.Actuation,
    "info": data_groups.Info,
}


@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_python_blocks_compile_and_use_existing_names(block):
    tree = ast.parse(block.text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            check(node)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("arena"):
            module = __import__(node.module or "", fromlist=["_"])
            assert all(hasattr(module, alias.name) for alias in node.names)


def check(node: ast.Attribute) -> None:
    value = node.value
    if isinstance(value, ast.Name) and value.id in ("uav", "UAV"):
        assert node.attr in NAMES, f"UAV has no {node.attr}"
    group = value.attr if isinstance(value, ast.Attribute) and ast.unparse(value.value) == "uav" else ""
    if group in GROUPS:
        known = {*dir(GROUPS[group]), *getattr(GROUPS[group], "__annotations__", ())}
        assert node.attr in known, f"uav.{group} has no {node.attr}"


# Methods, properties and attributes set by the constructor.
NAMES = {*dir(UAV), "ekf", "sen", "act", "info", "clock", "args"}


def test_readme_hello_world_is_short():
    hello = next(b for b in PYTHON if b.page.name == "README.md")
    assert len(hello.text.splitlines()) <= 10


@pytest.mark.parametrize("text", ["uav.set_pos(1)", "uav.ekf.position", "from arena import Drone"])
def test_unknown_name_in_a_python_block_is_detected(text):
    with pytest.raises(AssertionError):
        test_python_blocks_compile_and_use_existing_names(
            Block(page=ROOT, line=0, language="python", text=text)
        )
