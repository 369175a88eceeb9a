"""The supervisor with real processes: start order, restarts, faulty processes."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import sys

from arena.plan.model import Member, Restart

from .conftest import Run, eventually, is_running, plan_of, program, spec, world


def test_until_done_run_ends_by_itself_with_0(start):
    run: Run = start(plan_of(world(), program("p", "exits", "0", needs=("world",))), "until_done")
    assert run.wait() == 0
    assert [e["to"] for e in run.events("world")] == ["STARTING", "READY", "STOPPING", "EXITED"]
    assert run.outcome["processes"]["p"]["exit_code"] == 0
    assert not (run.folder / "state.json").exists()


def test_process_starts_after_its_needs_are_ready(start):
    run = start(plan_of(spec("a", "good"), program("p", "exits", "0", needs=("a",))), "until_done")
    assert run.wait() == 0
    order = [(e["process"], e["to"]) for e in run.events() if e.get("to")]
    assert order.index(("a", "READY")) < order.index(("p", "STARTING"))


def test_process_waits_for_the_member_that_it_needs(start, tmp_path):
    router = Member(name="router", kind="router")
    joined = spec("world", "ready_before_its_member", str(tmp_path / "go"), kind="world", members=(router,))
    run = start(
        plan_of(joined, program("p", "exits", "0", needs=("world", "router")), spec("a", "good")),
        "until_done",
    )
    run.until("world", "READY")
    run.until("a", "READY")
    assert not run.events("p")
    (tmp_path / "go").touch()
    assert run.wait() == 0


def test_transition_event_has_a_reason_and_two_times(start):
    run = start(plan_of(program("p", "exits", "3")), "until_done")
    assert run.wait() == 1
    assert all(e["reason"] and e["t"] and e["mono"] for e in run.events() if "to" in e)
    assert run.outcome["failed"] == ["p: exit 3"]


def test_program_killed_by_a_signal_fails_the_run(start):
    run = start(plan_of(program("p", "kills_itself"), program("q", "exits", "0")), "until_done")
    assert run.wait() == 1
    assert run.outcome["failed"] == ["p: killed by SIGKILL"]


def test_last_log_line_of_a_failed_process_is_shown(start):
    run = start(plan_of(program("p", "throws")), "until_done")
    assert run.wait() == 1
    assert "p: last line of its log: ValueError: no such setpoint" in run.said()


def test_world_is_told_which_programs_have_ended(start):
    names = {"program.uav1": "throws", "group.show": "throws"}
    listener = spec("world", "prints_requests", "{}", kind="world")
    run = start(plan_of(listener, *(program(n, what, needs=("world",)) for n, what in names.items())))
    for name in names:
        run.until(name, "EXITED")
    ended = ('"program": "uav1"', '"program": "group.show"')
    eventually(lambda: all(text in run.log("world") for text in ended))
    run.signal(signal.SIGTERM)
    run.wait()


def test_program_that_cannot_start_fails_with_the_reason(start):
    run = start(
        plan_of(spec("p", "x", kind="program", ready="started", argv=("/no/such/program",))), "until_done"
    )
    assert run.wait() == 1
    assert run.until("p", "FATAL")["reason"] == "could not start: /no/such/program: No such file or directory"


def test_never_ready_process_is_retried_then_fails(start):
    child = spec(
        "n", "never_ready", start_timeout_s=0.3, restart=Restart(mode="on_failure", limit=2, backoff_s=0.05)
    )
    run = start(plan_of(child, program("p", "exits", "0", needs=("n",))), "until_done")
    assert run.wait() == 1
    assert [e["to"] for e in run.events("n")] == [
        "STARTING",
        "STOPPING",
        "BACKOFF",
        "STARTING",
        "STOPPING",
        "FATAL",
    ]
    assert "not ready within 0.3 s" in run.until("n", "FATAL")["reason"]


def test_process_that_dies_is_restarted_up_to_its_limit(start):
    child = spec(
        "d", "dies_after_ready", kind="mocap", restart=Restart(mode="on_failure", limit=3, backoff_s=0.02)
    )
    run = start(plan_of(child, program("p", "sleeps", needs=("d",))), "until_done")
    assert run.wait() == 1
    assert run.until("d", "STARTING", times=3)
    assert "gave up after 3 starts" in run.until("d", "FATAL")["reason"]


def test_program_is_restarted_without_a_recorder_but_does_not_begin_without_one(start):
    again = Restart(mode="on_failure", backoff_s=0.02)
    run = start(
        plan_of(
            spec("recorder", "good", kind="recorder", restart=Restart(mode="never")),
            program("p", "sleeps", needs=("recorder",), restart=again),
        )
    )
    run.until("p", "READY")
    os.kill(run.pid("recorder"), signal.SIGKILL)
    run.until("recorder", "EXITED")
    os.kill(run.pid("p"), signal.SIGKILL)
    run.until("p", "READY", times=2)
    run.signal(signal.SIGTERM)
    run.wait()
    never = start(
        plan_of(
            spec("recorder", "dies_at_once", kind="recorder", restart=Restart(mode="never")),
            program("p", "sleeps", needs=("recorder",), restart=again),
        ),
        "until_done",
    )
    assert never.wait() == 1
    assert "needs recorder" in never.until("p", "FATAL")["reason"]


def test_failed_forwarder_stops_only_its_own_vehicles_program(start):
    forward = spec(
        "forward.uav1", "dies_at_once", kind="forward", vehicle="uav1", restart=Restart(mode="never")
    )
    run = start(
        plan_of(
            world(),
            forward,
            program("program.uav1", "exits", "0", vehicle="uav1", needs=("world", "forward.uav1")),
            program("program.uav2", "exits", "0", vehicle="uav2", needs=("world",)),
        ),
        "until_done",
    )
    assert run.wait() == 1
    assert "needs forward.uav1" in run.until("program.uav1", "FATAL")["reason"]
    assert run.outcome["processes"]["program.uav2"]["exit_code"] == 0
    assert run.outcome["cause"] == "done"


def test_port_is_proof_only_if_the_process_serves_it(start):
    taken = socket.create_server(("127.53.0.9", 0))
    port = taken.getsockname()[1]
    wrong = spec(
        "wrong", "sleeps", ready="port", ready_port=port, start_timeout_s=0.3, restart=Restart(mode="never")
    )
    right = spec("right", "serves", "127.53.0.10", str(port), ready="port", ready_port=port)
    run = start(plan_of(wrong, right))
    assert run.until("wrong", "FATAL") and run.until("right", "READY")["reason"] == f"serves port {port}"
    taken.close()
    run.signal(signal.SIGTERM)
    run.wait()


def test_process_that_ignores_sigterm_is_killed(start):
    run = start(plan_of(spec("i", "ignores_sigterm", stop_timeout_s=0.3)))
    run.until("i", "READY")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert run.outcome["processes"]["i"]["exit"] == "killed by SIGKILL"
    assert any("did not end within 0.3 s" in e.get("event", "") for e in run.events("i"))


def test_process_stopped_too_long_is_killed_and_restarted(start):
    run = start(plan_of(spec("s", "good", restart=Restart(mode="on_failure"), stopped_for_s=0.2)))
    run.until("s", "READY")
    os.kill(run.pid("s"), signal.SIGSTOP)
    run.until("s", "READY", times=2)
    assert "paused by SIGSTOP; killed after 0.2 s" in run.said()
    assert run.until("s", "BACKOFF")["reason"].startswith("paused for ")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_silent_process_is_killed_and_restarted(start):
    run = start(
        plan_of(spec("s", "good", restart=Restart(mode="on_failure"), silent_for_s=0.3), spec("t", "good"))
    )
    reason = run.until("s", "BACKOFF")["reason"]
    assert float(re.match(r"sent nothing for ([\d.]+) s", reason)[1]) >= 0.3
    run.until("s", "READY", times=2)
    assert not [e for e in run.events("t") if e.get("to") == "STOPPING"]
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_stopped_process_without_limit_continues_and_ends_with_the_run(start):
    run = start(plan_of(spec("s", "good", stopped_for_s=None, stop_timeout_s=60.0)))
    run.until("s", "READY")
    os.kill(run.pid("s"), signal.SIGSTOP)
    run.until_said("s: paused by SIGSTOP; the arena does not kill it")
    os.kill(run.pid("s"), signal.SIGCONT)
    run.until_said("s: runs again after it was paused for ")
    os.kill(run.pid("s"), signal.SIGSTOP)
    eventually(lambda: run.said().count("s: paused by SIGSTOP") == 2)
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert run.outcome["processes"]["s"]["exit"] == "exit 0" and "SIGKILL" not in run.said()


def test_grandchildren_in_their_own_session_end_with_their_program(start):
    run = start(plan_of(spec("g", "grandchild", restart=Restart(mode="never")), spec("other", "good")))
    run.until("g", "EXITED")
    eventually(lambda: len(run.sessions() & {run.pid("g")}) == 1)
    grand = [int(w.split()[1]) for w in run.log("g").splitlines() if w.startswith("grandchild")]
    assert len(grand) == 2
    eventually(lambda: not any(map(is_running, grand)), what="end of the grandchildren")
    assert run.process.poll() is None
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_group_of_an_ended_program_is_killed(start):
    run = start(
        plan_of(spec("g", "grandchild_in_group", restart=Restart(mode="never")), spec("other", "good")),
        "no_adopt",
    )
    run.until("g", "EXITED")
    (grand,) = [int(w.split()[1]) for w in run.log("g").splitlines() if w.startswith("grandchild")]
    eventually(lambda: not is_running(grand), what="end of the grandchild")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_flood_of_output_is_cut(start):
    run = start(plan_of(spec("f", "floods", ready="started")))
    eventually(lambda: any("MiB" in e.get("event", "") for e in run.events("f")))
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert (run.folder / "logs" / "f.log").stat().st_size < 1 << 30
    assert len([e for e in run.events("f") if "MiB" in e.get("event", "")]) == 1
    (run.folder / "logs" / "f.log").unlink()


def test_garbage_on_the_socket_is_ignored(start):
    run = start(plan_of(spec("g", "garbage")))
    run.until("g", "READY")
    assert run.control().ask(do="ps")["processes"]["g"]["stats"] == {"after": 1}
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert len([e for e in run.events("g") if "not a JSON object" in e.get("event", "")]) == 1


def test_process_that_closes_its_socket_stays_ready(start):
    run = start(plan_of(spec("c", "closes_its_line")))
    run.until("c", "READY")
    assert run.control().ask(do="ps")["processes"]["c"]["state"] == "READY"
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_flood_of_packets_does_not_stop_the_loop(start):
    run = start(plan_of(spec("c", "chatters", nice=10), spec("quiet", "good")))
    eventually(lambda: any("further events are dropped" in e.get("event", "") for e in run.events("c")))
    assert run.control().ask(do="ps")["processes"]["quiet"]["state"] == "READY"
    run.signal(signal.SIGTERM)
    assert run.wait() == 0


def test_time_limit_fails_a_run_that_waits_for_programs(start, tmp_path):
    run = start(plan_of(program("p", "sleeps")), "until_done", "limit=0.5")
    assert run.wait() == 1
    assert run.outcome["cause"] == "time limit"


def test_time_limit_without_until_done_succeeds(start):
    assert start(plan_of(program("p", "sleeps")), "limit=0.5").wait() == 0


def test_layers_stop_in_reverse_of_their_needs(start):
    run = start(plan_of(spec("a", "good"), spec("b", "good", needs=("a",)), spec("c", "good", needs=("b",))))
    run.until("c", "READY")
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    ends = [e["process"] for e in run.events() if e.get("to") == "EXITED"]
    stops = [(e["process"], e["to"]) for e in run.events() if e.get("to") in ("STOPPING", "EXITED")]
    assert ends == ["c", "b", "a"]
    assert stops.index(("c", "EXITED")) < stops.index(("b", "STOPPING"))


def test_cpu_and_memory_are_measured_and_budgets_reported(start):
    run = start(plan_of(spec("f", "burns", ready="started", cpu_budget=0.001, memory_budget_mb=1.0)))
    row = eventually(lambda: (f := run.control().ask(do="ps")["processes"]["f"])["cpu_s"] > 0.2 and f)
    run.signal(signal.SIGTERM)
    assert run.wait() == 0
    assert row["cpu_s"] > 0.2 and row["rss_peak_mb"] > 2 and len(row["over_budget"]) == 2


def test_crash_reported_by_the_world_fails_the_run(start):
    crashed = json.dumps({"vehicles": {"uav1": {"crashed": "touched a wall"}, "uav2": {"crashed": ""}}})
    run = start(plan_of(world("{}", crashed), program("p", "exits", "0", needs=("world",))), "until_done")
    assert run.wait() == 1
    assert run.outcome["failed"] == ["uav1 crashed: touched a wall"]


def test_the_report_runs_after_the_outcome_is_written(start):
    code = "import json; print('verdict', json.load(open('outcome.json'))['exit_code'])"
    report = spec("report", "", argv=(sys.executable, "-c", code), kind="task")
    run = start(plan_of(program("p", "exits", "0"), report=report), "until_done")
    assert run.wait() == 0
    assert run.log("report") == "verdict 0\n"


def test_report_that_ctrl_c_ended_gives_this_reason_and_the_command_to_repeat_it(start):
    report = spec("report", "sleeps", kind="task")
    run = start(plan_of(program("p", "exits", "0"), report=report), "until_done")
    eventually(lambda: run.control().ask(do="ps")["phase"] == "making the report")
    run.until_said("making the report")
    run.signal(signal.SIGINT)
    run.wait()
    assert (
        f"the report failed: ended by Ctrl-C: killed by SIGKILL; make it again with `arena report {run.folder}`"
        in run.said()
    )


def test_long_report_shows_its_present_step(start):
    code = "import time; print('progress: writing csv/uav3.csv (3 of 10)', flush=True); time.sleep(600)"
    report = spec("report", "", argv=(sys.executable, "-c", code), kind="task")
    run = start(plan_of(program("p", "exits", "0"), report=report), "until_done")
    run.until_said("making the report: writing csv/uav3.csv (3 of 10) (")
    run.signal(signal.SIGINT)
    run.wait()
    assert "progress:" not in run.said()
