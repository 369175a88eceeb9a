"""A campaign on a Ray cluster of two nodes on this computer, with fakes in place of flights."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from arena.campaign import preparation, ray_cluster, ray_task
from arena.campaign.design import Flight, flights
from arena.campaign.store import Record, Store
from arena.campaign.sweep import Sweep
from arena.cli import main
from arena.errors import InputError, NotInstalledError, RunError

from .conftest import HOST, record_of

Load = Callable[[str], Sweep]
PATIENCE_S = 120.0


def fly_in_a_node(flight: Flight, folder: Path, *, begun: Path) -> Record:
    """Write a file as a flight does, and return a record with the id of the Ray node. Flight 3 kills its worker once."""
    import ray

    with begun.open("a") as file:
        file.write(f"{flight.number}\n")
    if flight.number == 3 and begun.read_text().split().count("3") == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    own = folder / "flights" / flight.id / "csv"
    own.mkdir(parents=True)
    (own / "uav1.csv").write_text(f"flight {flight.number}\n" * 1000)
    time.sleep(0.5)
    return record_of(flight, run=ray.get_runtime_context().get_node_id())


def test_flights_on_two_nodes_return_their_files(sweep_of: Load, tmp_path: Path, address: str) -> None:
    found: list[Record] = []
    sweep, begun, results = sweep_of("seeds: 8\n"), tmp_path / "begun", tmp_path / "results"
    ray_cluster.fly_all(
        flights(sweep),
        results,
        address=address,
        inputs=ray_task.inputs_of(preparation.check(sweep, flights(sweep)).inputs, tmp_path),
        on_record=found.append,
        flown_by=partial(fly_in_a_node, begun=begun),
    )
    assert all(r.passed for r in found), [r.reasons for r in found]
    assert sorted(r.number for r in found) == list(range(1, 9))
    assert len({r.run for r in found}) == 2
    assert begun.read_text().split().count("3") == 2, "flown again, because its worker was killed"
    for record in found:
        log = results / "flights" / record.id / "csv" / "uav1.csv"
        assert log.read_text() == f"flight {record.number}\n" * 1000


def fly_until_interrupted(flight: Flight, folder: Path, *, notes: Path) -> Record:
    """Return a record at once for flight 1. All others fly until they are interrupted, and note their end."""
    if flight.number == 1:
        return record_of(flight)
    (notes / f"began-{flight.number}").touch()
    try:
        for _ in range(int(PATIENCE_S / 0.05)):
            time.sleep(0.05)
    except KeyboardInterrupt:
        (notes / f"ended-{flight.number}").touch()
        raise
    return record_of(flight)


def test_interruption_lands_the_flights_in_the_air(sweep_of: Load, tmp_path: Path, address: str) -> None:
    found: list[Record] = []

    def interrupt() -> None:
        if found and len(list(tmp_path.glob("began-*"))) == 2 and not stopped:
            stopped.append(os.kill(os.getpid(), signal.SIGINT))

    stopped: list[None] = []
    with pytest.raises(KeyboardInterrupt):
        ray_cluster.fly_all(
            flights(sweep_of("seeds: 6\n")),
            tmp_path,
            address=address,
            inputs={},
            on_record=found.append,
            on_poll=interrupt,
            flown_by=partial(fly_until_interrupted, notes=tmp_path),
        )
    assert [r.number for r in found] == [1]
    began = {p.name.partition("-")[2] for p in tmp_path.glob("began-*")}
    assert len(began) == 2, "no flight begins after the interruption"
    assert {p.name.partition("-")[2] for p in tmp_path.glob("ended-*")} == began


def test_interrupted_campaign_on_a_cluster_is_resumed(
    sweep_file: Callable[[str], Path],
    tmp_path: Path,
    address: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    begun = tmp_path / "begun"
    fly_all, fly = ray_cluster.fly_all, partial(fly_in_a_node, begun=begun)
    sweep = sweep_file(f"name: two\ncluster: {address}\narena: arena.yaml\nseeds: 4\n")

    def interrupted(*args: object, **more: object) -> None:
        on_record = more.pop("on_record")

        def note(record: Record) -> None:
            on_record(record)  # type: ignore[operator]
            os.kill(os.getpid(), signal.SIGINT)

        fly_all(*args, **more, on_record=note, flown_by=fly)  # type: ignore[arg-type]

    monkeypatch.setattr(ray_cluster, "fly_all", interrupted)
    assert main(["campaign", str(sweep)]) == 130
    kept = len(Store(tmp_path / "campaigns" / "two").records())
    assert kept >= 1
    monkeypatch.setattr(ray_cluster, "fly_all", partial(fly_all, flown_by=fly))
    assert main(["campaign", str(sweep)]) == 0
    assert f"4 flights, {kept} of them flown before" in capsys.readouterr().out
    assert len(list((tmp_path / "campaigns/two/flights").glob("*/csv/uav1.csv"))) == 4


def test_other_files_on_a_computer_are_refused(sweep_of: Load, tmp_path: Path, address: str) -> None:
    found = flights(sweep_of(""))
    inputs = {str(tmp_path / "arena.yaml"): "0" * 64, str(tmp_path / "none.py"): "0" * 64}
    with pytest.raises(InputError) as error:
        ray_cluster.fly_all(
            found,
            tmp_path,
            address=address,
            inputs=inputs,
            on_record=lambda _: None,
            flown_by=partial(fly_in_a_node, begun=tmp_path / "begun"),
        )
    lines = str(error.value).splitlines()
    assert len(lines) == 3 and all(HOST in line for line in lines[:2]), "both nodes are one computer"
    assert "arena.yaml differs from the file of the campaign" in lines[0] and "none.py is missing" in lines[1]


def test_computer_outside_the_cluster_is_told_what_to_run(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ray

    def outside(**_: object) -> None:
        raise RuntimeError("Can't find a node to connect to.")

    monkeypatch.setattr(ray, "init", outside)
    with pytest.raises(RunError, match=f"must belong to the cluster.*`ray start --address={address}`"):
        ray_cluster._connected(address)


def test_address_without_a_cluster_is_an_error_within_seconds() -> None:
    began = time.monotonic()
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(
        RunError, match=rf"no Ray cluster at 127.0.0.1:{port} \(Connection refused\).*ray start"
    ):
        ray_cluster.check_address(f"127.0.0.1:{port}")
    with pytest.raises(RunError, match=r"no Ray cluster at no-such-host\.invalid:1"):
        ray_cluster.check_address("no-such-host.invalid:1")
    assert time.monotonic() - began < 5 * ray_cluster.CONNECT_TIMEOUT_S


@pytest.mark.parametrize("answer", [b"SSH-2.0-OpenSSH_9.2\r\n", b"HTTP/1.1 400 Bad Request\r\n\r\n", b""])
def test_other_server_at_the_address_is_reported(answer: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(answer)
                connection.recv(100)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(RunError, match="another server answers there"):
            ray_cluster.check_address(f"127.0.0.1:{port}")
        thread.join()


def test_silent_server_at_the_address_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_cluster, "CONNECT_TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(RunError, match=r"no Ray cluster at .* \(timed out\)"):
            ray_cluster.check_address(f"127.0.0.1:{port}")


@pytest.mark.parametrize("address", ["lab", "lab:", ":6379", "ray://lab:10001", "lab:http"])
def test_other_form_of_the_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="expected HOST:PORT"):
        ray_cluster.check_address(address)


def test_auto_finds_the_cluster_that_was_started_last(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(ray_cluster, "_CURRENT_CLUSTER", tmp_path / "current")
    ray_cluster.check_address("auto")
    with socket.create_server(("127.0.0.1", 0)) as closed:
        ended = f"127.0.0.1:{closed.getsockname()[1]}"
    (tmp_path / "current").write_text(ended)
    with pytest.raises(RunError, match=f"no Ray cluster at {ended}"):
        ray_cluster.check_address("auto")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_cluster_on_the_loopback_interface_only_is_reported(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed: pip install '.[cluster]'")
    monkeypatch.setattr(ray, "init", lambda **_: pytest.fail("Ray would try for minutes"))
    monkeypatch.setattr(ray.util, "get_node_ip_address", lambda: "127.0.0.3")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(bytes((0, 0, 0, 4, 0, 0, 0, 0, 0)))
                connection.recv(100)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(RunError, match=rf"connects to 127.0.0.3:{port}: .*--node-ip-address=127.0.0.3"):
            ray_cluster._connected(f"{host}:{port}")
        thread.join()


def test_auto_without_a_cluster_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed: pip install '.[cluster]'")
    monkeypatch.setattr(ray_cluster, "_CURRENT_CLUSTER", tmp_path / "none")

    def none_running(**_: object) -> None:
        raise ConnectionError("Could not find any running Ray instance.")

    monkeypatch.setattr(ray, "init", none_running)
    with pytest.raises(RunError, match=r"Could not find any running Ray instance.*`ray start --head`"):
        ray_cluster._connected("auto")


def test_cluster_without_ray_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(NotInstalledError, match=r"flying-arena\[cluster\]"):
        ray_cluster._connected("127.0.0.1:1")


def test_jobs_and_cluster_together_are_refused(
    sweep_file: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = sweep_file("arena: arena.yaml\n")
    assert main(["campaign", str(sweep), "-j", "2", "--cluster", "lab:6379"]) == 2
    assert "got both --cluster and --jobs, expected one of them" in capsys.readouterr().err


def test_packed_files_are_unpacked_in_their_folders(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "c.csv").write_bytes(b"1,2\n" * 9)
    (tmp_path / "d").write_bytes(b"")
    ray_task.unpack(ray_task.pack(tmp_path), tmp_path / "new")
    assert (tmp_path / "new/a/b/c.csv").read_bytes() == b"1,2\n" * 9
    assert (tmp_path / "new/d").read_bytes() == b""
