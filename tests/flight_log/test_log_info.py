"""Content of log files."""

from __future__ import annotations

import pytest
from recorded_flights import flight_csv
from recorded_traffic import record_of, traffic
from ulog_files import write_ulog

from arena.errors import InputError
from arena.flight_log.log_info import LogInfo, Stream, log_info


def stream(found: LogInfo, name: str) -> Stream:
    (one,) = [s for s in found.streams if s.name == name]
    return one


def test_record_lists_topics_messages_and_rates(tmp_path):
    data = traffic(4.0)
    found = log_info(record_of(tmp_path / "flight.mcap", data))
    assert found.incomplete == "" and found.messages == len(data)
    assert found.length_s == pytest.approx(4.0, abs=0.1)
    attitude = stream(found, "/uav1/mavlink/down ATTITUDE_QUATERNION (1/1)")
    assert attitude.count == 199 and attitude.rate_hz == pytest.approx(50.0, rel=0.01)
    frames = stream(found, "/mocap/frames")
    assert frames.gaps == 1 and frames.longest_s == pytest.approx(0.8, abs=0.01)
    assert stream(found, "/uav1/mavlink/up POSITION_TARGET_LOCAL_NED (1/191)").count == 60


def test_brief_content_does_not_read_mavlink(tmp_path):
    found = log_info(record_of(tmp_path / "flight.mcap", traffic(1.5)), brief=True)
    assert [s.name for s in found.streams if "(" in s.name] == []


def test_record_of_a_killed_recorder_says_so(tmp_path):
    path = record_of(tmp_path / "flight.mcap", traffic(2.0))
    path.write_bytes(path.read_bytes()[:-200])
    found = log_info(path)
    assert "flight.mcap has no end" in found.incomplete and found.messages > 0


def test_slow_messages_have_no_gaps():
    slow = Stream("heartbeat")
    for t in range(10):
        slow.add(float(t))
    assert slow.gaps == 0 and slow.longest_s == 1.0
    slow.add(20.0)
    assert slow.gaps == 1


def test_ulog_lists_its_topics(tmp_path):
    stamp = {"timestamp": "uint64_t", "load": "float"}
    path = write_ulog(tmp_path / "a.ulg", {"cpuload": (stamp, [(k * 500_000, 0.5) for k in range(5)])})
    found = log_info(path)
    assert stream(found, "cpuload").rate_hz == pytest.approx(2.0) and found.messages == 5


def test_cut_csv_log_says_so(tmp_path):
    path = tmp_path / "uav1.csv"
    path.write_text(flight_csv()[:-40])
    found = log_info(path)
    assert "incomplete" in found.incomplete and found.messages == 299


def test_other_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.mcap"):
        log_info(tmp_path / "none.mcap")
