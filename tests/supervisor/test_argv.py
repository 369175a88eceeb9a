"""No shell stands between the YAML and a program: words reach it as they were written."""

from __future__ import annotations

import ast
import json
import os
import sys
from pathlib import Path

import pytest

from arena.errors import InputError
from arena.plan import make_plan
from arena.plan.model import ProcessSpec
from arena.schema import load_arena

from .conftest import plan_of

ROOT = Path(__file__).parents[2]
NASTY = [
    "two words",
    "'",
    '"',
    "; touch pwned",
    "$(touch pwned)",
    "`touch pwned`",
    "&& touch pwned",
    "| touch pwned",
    "> pwned",
    "*",
    "~",
    "$HOME",
    "\\",
    "new\nline",
    "",
    "--",
    "-rf",
    "ünïcode",
    "%s {0}",
]
SHELLS = {"system", "popen", "getoutput", "getstatusoutput", "create_subprocess_shell", "popen2"}


def shells(tree: ast.AST) -> list[str]:
    """Calls that hand a string to a shell, and argument lists that begin with one."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        owner = getattr(getattr(node.func, "value", None), "id", "")
        if name in SHELLS and owner in ("os", "subprocess", "asyncio", ""):
            found.append(f"line {node.lineno}: {name}")
        for keyword in node.keywords:
            if keyword.arg == "shell" and not (
                isinstance(keyword.value, ast.Constant) and keyword.value.value is False
            ):
                found.append(f"line {node.lineno}: shell=")
        for word in (w for a in node.args if isinstance(a, (ast.List, ast.Tuple)) for w in a.elts[:1]):
            if isinstance(word, ast.Constant) and str(word.value).rpartition("/")[2] in (
                "sh",
                "bash",
                "dash",
                "zsh",
            ):
                found.append(f"line {node.lineno}: {word.value}")
    return found


@pytest.mark.parametrize("folder", ["arena", "examples", "benchmarks"])
def test_no_code_passes_a_string_to_a_shell(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files and not {str(p): found for p in files if (found := shells(ast.parse(p.read_text())))}


@pytest.mark.parametrize(
    "code",
    [
        "os.system('ls')",
        "os.popen(x)",
        "subprocess.run('ls', shell=True)",
        "subprocess.Popen(x, shell=y)",
        "subprocess.getoutput('x')",
        "subprocess.run(['/bin/sh', '-c', x])",
        "subprocess.run(('bash', '-c', x))",
        "asyncio.create_subprocess_shell(x)",
    ],
)
def test_the_search_finds_each_way(code):
    assert shells(ast.parse(code))


def test_yaml_arguments_reach_the_program_unchanged(start, tmp_path):
    odd = tmp_path / "a folder; $(touch pwned) 'x'"
    odd.mkdir()
    program, out = odd / "tell me.py", tmp_path / "argv.json"
    program.write_text(f"import json, sys\njson.dump(sys.argv, open({str(out)!r}, 'w'))\n")
    file = odd / "arena.yaml"
    flown = {"path": str(program), "args": NASTY}
    tool = {"argv": [sys.executable, str(program), *NASTY], "restart": "never"}
    file.write_text(
        json.dumps({"vehicles": {"uav1": {"autopilot": "builtin", "program": flown}}, "tools": {"t": tool}})
    )
    plan = make_plan(load_arena(file))
    for name in ("program.uav1", "tool.t"):
        (spec,) = (s for s in plan.processes if s.name == name)
        alone = ProcessSpec(name="x", kind="program", argv=spec.argv, cwd=spec.cwd, ready="started")
        out.unlink(missing_ok=True)
        assert start(plan_of(alone), "until_done").wait(60) == 0
        told = json.loads(out.read_text())
        assert told[-len(NASTY) :] == NASTY and told[0] == str(program)
    assert not list(tmp_path.rglob("pwned"))


def test_nice_value_of_a_process_is_added_to_the_callers(start, tmp_path):
    out, mine = tmp_path / "nice", os.getpriority(os.PRIO_PROCESS, 0)
    code = f"import os; open({str(out)!r}, 'w').write(str(os.getpriority(os.PRIO_PROCESS, 0)))"
    for added in (0, 3):
        alone = ProcessSpec(
            name="x", kind="program", argv=(sys.executable, "-c", code), ready="started", nice=added
        )
        assert start(plan_of(alone), "until_done").wait(60) == 0
        assert int(out.read_text()) == min(mine + added, 19)


@pytest.mark.parametrize("name", ["a b", "a;b", "$(a)", "a'b", "../a", "a/b", "-a", ""])
def test_vehicle_name_with_shell_or_path_characters_is_refused(tmp_path, name):
    file = tmp_path / "arena.yaml"
    file.write_text(json.dumps({"vehicles": {name: {"autopilot": "builtin"}}}))
    with pytest.raises(InputError):
        load_arena(file)
