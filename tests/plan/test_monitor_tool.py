"""`tools: {monitor: true}`: the page of `arena monitor` as a process of the arena."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys

import pytest

from arena.cli._page import with_page
from arena.errors import InputError
from arena.plan import make_plan
from arena.plan.machine import check_machine
from arena.schema import load_arena

from .machines import FreePorts

VEHICLES = "vehicles: {uav1: {start: {position: [0, 0, 0]}, autopilot: builtin}}\n"


def plan_of(folder, more, *overrides):
    (folder / "arena.yaml").write_text(VEHICLES + more)
    return make_plan(load_arena(folder / "arena.yaml", list(overrides)), sys.executable)


def tool(plan):
    return next((p for p in plan.processes if p.name == "tool.monitor"), None)


def test_true_starts_the_page_with_low_priority(tmp_path):
    spec = tool(plan_of(tmp_path, "tools: {monitor: true}"))
    assert spec.argv == (sys.executable, "-m", "arena", "monitor", "--run", "{run}")
    assert spec.nice > 0 and not spec.outlives and spec.kind == "tool"
    assert tool(plan_of(tmp_path, "", "tools.monitor=true")) == spec


def test_no_process_needs_the_page(tmp_path):
    plan = plan_of(tmp_path, "tools: {monitor: true}")
    assert all("tool.monitor" not in p.needs for p in plan.processes)


def test_false_starts_nothing_and_other_tools_stay(tmp_path):
    more = "tools: {monitor: false, other: {argv: [sleep, '1']}}"
    plan = plan_of(tmp_path, more)
    assert tool(plan) is None and any(p.argv == ("sleep", "1") for p in plan.processes)


def test_page_does_not_need_the_command_arena_on_the_path(tmp_path):
    class Bare(FreePorts):
        def has_command(self, command, folder):
            return False

    plan = plan_of(tmp_path, "tools: {monitor: true}")
    check_machine(load_arena(tmp_path / "arena.yaml"), plan, Bare())


def test_resolved_yaml_has_the_same_page(tmp_path):
    plan = plan_of(tmp_path, "tools: {monitor: true}")
    again = tmp_path / "again"
    again.mkdir()
    (again / "arena.yaml").write_text(plan.yaml)
    assert tool(make_plan(load_arena(again / "arena.yaml"), sys.executable)).argv == tool(plan).argv


def test_other_tools_cannot_be_true(tmp_path):
    with pytest.raises(InputError, match="tools"):
        plan_of(tmp_path, "tools: {other: true}")


def test_url_is_known_before_the_start(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    plan = plan_of(tmp_path, "tools: {monitor: true}")
    placed, line = with_page(plan, url=True)
    host, port = tool(placed).argv[-3], tool(placed).argv[-1]
    assert line == f"watch live, when the page has started: http://{host}:{port}/" and host == "127.0.0.1"
    assert with_page(plan, url=False)[1] == "", "the page itself reports its URL when it answers"
    plain = plan_of(tmp_path, "")
    assert with_page(plain, url=True) == (plain, "")


def test_page_of_an_open_arena_stays_on_loopback(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    plan = dataclasses.replace(plan_of(tmp_path, "tools: {monitor: true}"), address="192.168.1.4")
    assert "--host 127.0.0.1" in " ".join(tool(with_page(plan, url=True)[0]).argv)


def test_flight_without_viser_has_no_page(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    plan, line = with_page(plan_of(tmp_path, "tools: {monitor: true}"), url=False)
    assert tool(plan) is None and line.startswith("no page: the package viser is not installed")
