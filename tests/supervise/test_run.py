"""The supervisor with real processes: order, restarts, misfits, the end of a run."""

from __future__ import annotations

from .conftest import Run, eventually, plan_of, program, spec, world


def test_a_run_of_good_programs_ends_by_itself_with_0(start):
    run: Run = start(plan_of(world(), program("p", "exits", "0", needs=("world",))), "until_done")
    assert run.wait() == 0
    assert [e["to"] for e in run.events("world")] == ["STARTING", "READY", "STOPPING", "EXITED"]
    assert run.outcome["processes"]["p"]["exit_code"] == 0
    assert not (run.folder / "state.json").exists()
