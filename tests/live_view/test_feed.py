"""The live feed without an arena, and beside a run that ends."""

import json
import subprocess
import sys

from arena.live_view import LiveFeed
from arena.live_view.feed import SEARCH_PERIOD_S, _Tail
from arena.plan import make_plan
from arena.schema import load_arena
from arena.supervisor import run_folder

YAML = "vehicles: {uav1: {start: {position: [0, 0, 0]}, autopilot: builtin}}"


def start_run(folder, runs):
    """Make the folders of a run whose supervisor is the test."""
    (folder / "arena.yaml").write_text(YAML)
    plan = make_plan(load_arena(folder / "arena.yaml"))
    return run_folder.create(plan, runs)


def test_feed_waits_while_no_arena_runs(runtime_dir):
    feed = LiveFeed()
    assert feed.poll(0.0) is None
    assert "no arena is running" in feed.waiting_for
    feed.close()


def test_feed_finds_an_arena_survives_its_end_and_finds_the_next(tmp_path, runtime_dir):
    feed = LiveFeed()
    assert feed.poll(0.0) is None
    for k in (1, 2):
        run = start_run(tmp_path, tmp_path / "runs")
        now = 100.0 * k
        found = feed.poll(now)
        assert found is not None and found.run == run.path and found.fleet.names == ("uav1",)
        assert not found.answers, "this run has no control socket"
        run.close()
        # this process is the supervisor of the run, so the run ends by its recorded start time
        feed._open._state = dead(feed._open._state)
        assert feed.poll(now + SEARCH_PERIOD_S) is None
    feed.close()


def dead(state):
    with subprocess.Popen([sys.executable, "-c", ""]) as child:
        child.wait()
        supervisor = run_folder.Member(pid=child.pid, pgid=child.pid, start_s=0.0)
    return run_folder.RunState(**{**vars(state), "supervisor": supervisor})


def test_several_arenas_are_named(tmp_path, runtime_dir):
    runs = [start_run(tmp_path, tmp_path / "runs") for _ in range(2)]
    feed = LiveFeed()
    assert feed.poll(0.0) is None
    assert all(str(run.path) in feed.waiting_for for run in runs)
    chosen = LiveFeed(runs[1].path)
    assert chosen.poll(0.0).run == runs[1].path
    chosen.close()
    for run in runs:
        run.close()


def test_run_of_another_version_is_reported_and_not_fatal(tmp_path, runtime_dir):
    run = start_run(tmp_path, tmp_path / "runs")
    file = run.path / "slices" / "view.json"
    raw = json.loads(file.read_text())
    del raw["vehicles"]
    file.write_text(json.dumps(raw))
    feed = LiveFeed()
    assert feed.poll(0.0) is None and "another version" in feed.waiting_for
    file.unlink()
    assert feed.poll(1.0) is None and feed.waiting_for
    feed.close()
    run.close()


def test_tail_returns_whole_lines_once(tmp_path):
    path = tmp_path / "events.jsonl"
    tail = _Tail(path)
    assert tail.read() == []
    path.write_bytes(b"one\ntw")
    assert tail.read() == [b"one"]
    with path.open("ab") as file:
        file.write(b"o\nthree\n")
    assert tail.read() == [b"two", b"three"]
    assert tail.read() == []
