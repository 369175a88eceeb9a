"""CPU load and memory of the processes over time, processes.csv."""

from __future__ import annotations

from arena.background_writer import BackgroundWriter
from arena.report.run_data import read_loads
from arena.supervisor import load_log
from arena.supervisor.load_log import LoadLog


def test_samples_are_read_back(tmp_path):
    writer, times = BackgroundWriter("files", 100), [None, 1.0, 2.0]
    log = LoadLog(tmp_path / "processes.csv", writer, lambda: times.pop(0))
    log.add({"router": (0.5, 10.0)})  # the world does not run yet, so this sample has no time
    log.add({"router": (0.25, 20.0), "forward.uav1": (0.125, 30.5)})
    log.add({"router": (0.75, 21.0)})
    log.close()
    assert writer.flush(30.0)
    with (tmp_path / "processes.csv").open("a") as file:
        file.write("3.0,rou")  # the supervisor was killed
    found = read_loads(tmp_path / "processes.csv")
    assert found.keys() == {"router", "forward.uav1"}
    assert found["router"].t.tolist() == [1.0, 2.0]
    assert found["router"].cpu.tolist() == [0.25, 0.75]
    assert found["router"].rss_mb.tolist() == [20.0, 21.0]


def test_full_disk_ends_only_this_log(tmp_path, monkeypatch):
    def full(fd: int, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    writer = BackgroundWriter("files", 100)
    log = LoadLog(tmp_path / "processes.csv", writer, lambda: 1.0)
    assert writer.flush(30.0)
    with monkeypatch.context() as patch:
        patch.setattr(load_log, "write_all", full)
        log.add({"router": (0.5, 10.0)})
        assert writer.flush(30.0)
    log.add({"router": (0.5, 10.0)})
    log.close()
    assert writer.flush(30.0)
    assert (tmp_path / "processes.csv").read_text() == f"{load_log.HEADER}\n"


def test_run_without_this_file_has_no_loads(tmp_path):
    assert read_loads(tmp_path / "processes.csv") == {}
