"""An operator is present: in a terminal that accepts output, or with a recent command."""  # review fault 20

from __future__ import annotations

import os
import subprocess
import sys
import time

from arena.supervisor import run_folder
from arena.supervisor.loop import Supervisor
from arena.supervisor.operator_presence import OperatorPresence
from arena.supervisor.run_options import Options
from arena.supervisor.terminal import Lines

from .conftest import plan_of, vehicle

CODE = "from arena.supervisor.operator_presence import at_terminal; open({path!r}, 'w').write(str(at_terminal()))"


def test_terminal_that_accepts_output_counts():
    operator = OperatorPresence()
    assert operator.present(0.0, terminal=True, blocked_s=0.0)
    assert not operator.present(0.0, terminal=True, blocked_s=5.0), "frozen, or its connection stalled"
    assert not operator.present(0.0, terminal=False, blocked_s=0.0)


def test_command_counts_for_a_minute():
    operator = OperatorPresence()
    operator.on_command(100.0)
    assert operator.present(159.0, terminal=False, blocked_s=0.0)
    assert not operator.present(161.0, terminal=False, blocked_s=0.0)


def run_in(tmp_path, *, terminal: bool, foreground: bool) -> str:
    """Return what `at_terminal` says in a process with or without a terminal."""
    found = tmp_path / "found"
    if not terminal:
        with subprocess.Popen(
            [sys.executable, "-c", CODE.format(path=str(found))],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        ) as process:
            process.wait(60)
        return found.read_text()
    pid, master = os.forkpty()
    if pid == 0:
        if not foreground:
            if os.fork():
                os.wait()
                os._exit(0)
            os.setpgid(0, 0)
        os.execv(sys.executable, [sys.executable, "-c", CODE.format(path=str(found))])
    os.waitpid(pid, 0)
    os.close(master)
    return found.read_text()


def test_only_the_foreground_of_a_terminal_counts(tmp_path):
    assert run_in(tmp_path, terminal=True, foreground=True) == "True"
    assert run_in(tmp_path, terminal=True, foreground=False) == "False"
    assert run_in(tmp_path, terminal=False, foreground=False) == "False"


def test_viewers_are_no_sign_of_an_operator(tmp_path, runtime_dir):
    plan = plan_of(vehicles=(vehicle("real", simulated=False),))
    supervisor = Supervisor(plan, run_folder.create(plan, tmp_path), Lines(), Options())
    assert supervisor.answer({"do": "view"})["vehicles"] == ["real"]
    assert not supervisor._operator.present(time.monotonic(), terminal=False, blocked_s=0.0)
    supervisor.answer({"do": "ps"})
    assert supervisor._operator.present(time.monotonic(), terminal=False, blocked_s=0.0)
