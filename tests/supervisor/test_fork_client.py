"""Processes of the fork server are the same as those of a new interpreter, and the fork server is not needed."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arena import cli
from arena.constants import PROCESS_ENV
from arena.plan.model import ProcessSpec
from arena.supervisor import proc_fs

from .conftest import Run, eventually, plan_of, program, spec

HEAD = """
import json, os, sys
import helper
def facts():
    return {"forked": "arena.fork_server.forked_process" in sys.modules, "sid": os.getsid(0), "pid": os.getpid(),
        "seen": open("/proc/self/cmdline").read().rstrip("\\0").split("\\0"), "argv": sys.argv, "orig": sys.orig_argv,
        "path": sys.path[0], "cwd": os.getcwd(), "nice": os.getpriority(os.PRIO_PROCESS, 0), "name": __name__, "file": __file__,
        "main": sys.modules["__main__"].__dict__ is globals(), "env": {k: v for k, v in os.environ.items() if k != "ARENA_FD"},
        "marks": sorted(x for x in open("/proc/self/environ").read().split("\\0") if x.startswith(("ARENA_RUN=", "ARENA_PROCESS="))),
        "package": __package__, "stdin": os.readlink("/proc/self/fd/0"), "comm": open("/proc/self/comm").read(),
        "threshold": __import__("gc").get_threshold()}
json.dump(facts(), open(sys.argv[1], "w"))
print("printed", flush=True)
"""
ENDS = {
    "returns": "",
    "exit code": "sys.exit(7)",
    "exit text": "sys.exit('no vehicle')",
    "error": "def fails():\n    raise ValueError('wrong')\nfails()",
    "own hook": "sys.excepthook = lambda *a: print('hook', a[0].__name__, a[2].tb_lineno, a[2].tb_next)\nraise OSError",
    "interrupt": "raise KeyboardInterrupt",
    "signal": "import signal; os.kill(os.getpid(), signal.SIGTERM)",
    "syntax error": "def",
    "at exit": "import atexit; atexit.register(print, 'ended')",
    "thread": "import threading, time\nthreading.Timer(0.1, lambda: print('thread', __name__, json)).start()",
}


def program_of(folder: Path, code: str, *arguments: str, **changes: Any) -> ProcessSpec:
    (folder / "helper.py").touch()
    file = folder / "flies.py"
    file.write_text(code)
    argv = (sys.executable, str(file), *arguments)
    given = {"argv": argv, "env": PROCESS_ENV, "nice": 2, "cwd": str(folder), **changes}
    return program("p", "", **given)


@pytest.fixture(scope="module")
def ended_runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Run]]:
    """Give two ended runs of the same programs, one per way to end: with new interpreters, and with the fork server."""
    folder = tmp_path_factory.mktemp("ends")
    runs: dict[str, Run] = {}
    with (
        pytest.MonkeyPatch.context() as patch,
        tempfile.TemporaryDirectory(prefix="arena-test-") as runtime,
    ):
        patch.setenv("ARENA_RUNTIME_DIR", runtime)
        for option in ("no_forks", "forks"):
            programs = []
            for end, code in ENDS.items():
                (own := folder / name_of(end)).mkdir(exist_ok=True)
                made = program_of(own, HEAD + code + "\n", str(own / f"{option}.json"))
                programs.append(replace(made, name=name_of(end)))
            (run_folder := folder / option).mkdir()
            runs[option] = Run(run_folder, plan_of(*programs), "until_done", option)
        for run in runs.values():
            run.wait()
        yield runs
        left = [run.end() for run in runs.values()]
    assert not any(left), f"still running after the tests: {left}"


def name_of(end: str) -> str:
    """Return the name of the program with this way to end."""
    return end.replace(" ", "_")


@pytest.mark.parametrize("end", ENDS)
def test_forked_program_behaves_as_in_an_interpreter(ended_runs, end):
    results = []
    for option, run in ended_runs.items():
        row = run.outcome["processes"][name_of(end)]
        log = run.log(name_of(end))
        out = run.runs.parents[1] / name_of(end) / f"{option}.json"
        found = json.loads(out.read_text()) if end != "syntax error" else {}
        text = json.dumps(found).replace(str(run.folder), "RUN").replace(f"{option}.json", "OUT")
        results.append((row["exit_code"], row["exit"], log, json.loads(text)))
    alone, forked = results
    assert forked[:3] == alone[:3]
    if end == "syntax error":
        return
    assert (alone[3].pop("forked"), forked[3].pop("forked")) == (False, True)
    for facts in (alone[3], forked[3]):
        assert facts.pop("sid") == facts.pop("pid")
    assert forked[3] == alone[3]


def test_programs_have_different_random_numbers(start, tmp_path):
    code = "import numpy, random, sys\nopen(sys.argv[1], 'a').write(f'{numpy.random.rand()} {random.random()}\\n')"
    out = tmp_path / "numbers"
    first = program_of(tmp_path, code, str(out))
    second = replace(first, name="q")
    assert start(plan_of(first, second), "until_done", "forks").wait() == 0
    numbers = out.read_text().split()
    assert len(numbers) == len(set(numbers)) == 4


def test_program_whose_folder_hides_a_module_gets_an_interpreter(start, tmp_path):
    (tmp_path / "pymavlink.py").write_text("MINE = True")
    code = "import sys, pymavlink\nsys.exit(0 if pymavlink.MINE and 'numpy' not in sys.modules else 1)"
    assert start(plan_of(program_of(tmp_path, code)), "until_done", "forks").wait() == 0


def test_fork_server_ends_when_all_processes_have_started(start, tmp_path):
    run = start(plan_of(spec("a", "good")), "forks")
    run.until("a", "READY")
    run.until_said("1 process ready")
    eventually(lambda: proc_fs.children(run.process.pid) == [run.state.processes["a"].pid])
    run.signal(signal.SIGINT)
    run.wait()


def test_arena_up_continues_if_no_fork_server_can_be_started(monkeypatch):
    def no_process(*args: Any, **more: Any) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr("arena.supervisor.fork_client.subprocess.Popen", no_process)
    with cli._fork_server(["up"]) as forks:
        assert forks is None


def test_killed_fork_server_is_replaced_by_an_interpreter(start, tmp_path):
    """The first program kills the fork server; the second program, which starts after that, starts all the same."""
    kill = (
        "import os, pathlib, signal, sys, time\n"
        "pids = pathlib.Path(f'/proc/{os.getppid()}/task/{os.getppid()}/children').read_text().split()\n"
        "server, = set(map(int, pids)) - {os.getpid()}\n"
        "os.kill(server, signal.SIGKILL)\n"
        "pathlib.Path(sys.argv[1]).touch()\n"
        "while not pathlib.Path(sys.argv[2]).exists(): time.sleep(0.01)\n"
    )
    killed, ended = tmp_path / "killed", tmp_path / "ended"
    first = replace(
        program_of(tmp_path, kill, str(killed), str(ended)), ready="file", ready_value=str(killed)
    )
    (other := tmp_path / "other").mkdir()
    code = "import sys; open(sys.argv[1], 'w'); sys.exit(5 if 'arena.fork_server' in sys.modules else 0)"
    second = replace(program_of(other, code, str(ended)), name="q", needs=("p",))
    run = start(plan_of(first, second), "until_done", "forks")
    run.wait()
    processes = run.outcome["processes"]
    assert (processes["p"]["exit_code"], processes["q"]["exit_code"]) == (0, 0), run.log("p")
    assert processes["q"]["starts"] == 1


def test_forked_program_dies_with_the_supervisor(start, tmp_path):
    code = "import os, sys, time\nopen(sys.argv[1], 'w').write(str(os.getpid()))\ntime.sleep(600)"
    run = start(plan_of(program_of(tmp_path, code, str(tmp_path / "pid"))), "forks")
    pid = int(eventually(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text()))
    os.kill(run.process.pid, signal.SIGKILL)
    eventually(lambda: proc_fs.start_time(pid) is None or proc_fs.is_zombie(pid))
