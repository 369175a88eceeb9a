"""Vehicles that were reported as armed since the supervisor last looked."""

from __future__ import annotations

from arena.supervisor.armed_reports import LONGEST_GAP_S, ArmedReports

from .conftest import spec


def test_vehicle_that_was_armed_between_two_looks_is_found_once():
    reports = ArmedReports()
    reports.on_facts({"uav1.armed": True, "uav2.armed": False, "uav2.mode": "OFFBOARD"})
    reports.on_facts({"uav1.armed": False})
    assert reports.take({"uav1", "uav2"}, 1.0) == {"uav1"}
    assert reports.take({"uav1", "uav2"}, 1.1) == set()


def test_measurements_of_a_link_count():
    reports = ArmedReports()
    reports.on_stats(spec("link.uav1", "x", kind="link", vehicle="uav1"), {"armed": True})
    reports.on_stats(spec("program.uav2", "x", kind="program", vehicle="uav2"), {"armed": True})
    assert reports.take(set(), 1.0) == {"uav1"}


def test_after_a_long_pause_every_vehicle_may_have_been_armed():
    reports = ArmedReports()
    assert reports.take({"uav1"}, 1.0) == set()
    assert reports.take({"uav1"}, 2.0 + LONGEST_GAP_S) == {"uav1"}
    assert reports.take({"uav1"}, 2.1 + LONGEST_GAP_S) == set()
