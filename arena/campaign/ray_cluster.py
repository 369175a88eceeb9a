"""Flights of a campaign on the computers of a Ray cluster.

Each flight is one Ray task and uses one CPU core.

This computer is one of the cluster. It collects the records and the run folders of all flights.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from arena.campaign.design import Flight
from arena.campaign.fly import fly
from arena.campaign.ray_task import Delivery, fly_here, problems_here, unpack
from arena.campaign.runner import ATTEMPTS, Fly, OnRecord, lost_record
from arena.errors import InputError, NotInstalledError, RunError
from arena.smoke.flying.workers import POLL_S, collected_stops

CONNECT_TIMEOUT_S = 5.0
"""Wall time in which the cluster must answer [s]."""
_REQUEST_TIMEOUT_S = 20  # Ray's own limit is 60 s
_CHECK_TIMEOUT_S = 120.0  # a computer that has just joined starts its first worker
_LANDING_TIMEOUT_S = 180.0  # time for interrupted flights to land, before their workers are killed
# HTTP/2: the first bytes of a client, with an empty SETTINGS frame. The server answers with a SETTINGS frame.
_HTTP2_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
_SETTINGS = 4  # byte 3 of the answer: the type of the frame
# Hosts that Ray replaces by the computer's network address
_REPLACED_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
_CURRENT_CLUSTER = Path(tempfile.gettempdir(), "ray", "ray_current_cluster")  # written by `ray start`


def fly_all(
    flights: Sequence[Flight],
    folder: Path,
    *,
    address: str,
    inputs: Mapping[str, str],
    on_record: OnRecord,
    on_poll: Callable[[], None] = lambda: None,
    flown_by: Fly = fly,
) -> None:
    """Fly all flights on a Ray cluster.

    Ray starts a flight again if its worker or its computer fails.

    address: HOST:PORT of the cluster, or `auto` for the cluster of this computer.
    inputs: absolute path -> SHA-256 of the files that every computer must have.
    on_record, on_poll, flown_by: as in `runner.fly_all`. The files of a flight are in `folder` before `on_record` is called.
    Raises NotInstalledError without Ray, RunError if there is no cluster at the address, InputError if a computer has
    other files, and KeyboardInterrupt after Ctrl-C, when the flights have ended.
    """
    ray = _connected(address)
    try:
        _check_computers(ray, inputs)
        with collected_stops() as stops:
            task = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(fly_here)
            inputs_there = ray.put(dict(inputs))
            pending = {task.remote(_absolute(flight), inputs_there, flown_by): flight for flight in flights}
            _collect(_Campaign(ray, folder, on_record, on_poll, pending), stops)
    finally:
        ray.shutdown()
    if stops:
        raise KeyboardInterrupt


@dataclass
class _Campaign:
    """Flights that run or wait on the Ray cluster.

    pending: Ray's reference -> flight
    """

    ray: Any
    folder: Path
    on_record: OnRecord
    on_poll: Callable[[], None]
    pending: dict[Any, Flight]

    def poll(self) -> None:
        """Record the results of the flights that have ended on the cluster, and show the progress.

        Wait up to POLL_S for the end of a flight.
        """
        ended, _ = self.ray.wait(list(self.pending), num_returns=1, timeout=POLL_S)
        for one in ended:
            self._end(one, self.pending.pop(one))
        self.on_poll()

    def _end(self, one: Any, flight: Flight) -> None:
        try:
            delivery: Delivery = self.ray.get(one)
        except self.ray.exceptions.TaskCancelledError:
            return
        except self.ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, InputError):  # raised by a computer that joined the cluster later
                raise InputError(str(error.cause)) from error
            self.on_record(lost_record(flight, _last_line(error), times=1))
        except self.ray.exceptions.RayError as error:
            self.on_record(lost_record(flight, type(error).__name__))
        else:
            unpack(delivery.files, self.folder)
            self.on_record(delivery.record)

    def cancel(self, *, kill: bool) -> None:
        """Interrupt the flights that run on the cluster, and cancel the flights that wait for a worker.

        kill: True to end the workers at once
        """
        for one in self.pending:
            self.ray.cancel(one, force=kill)


def _collect(campaign: _Campaign, stops: Sequence[int]) -> None:
    """Record the result of each flight on the cluster, until all flights have ended.

    At the first Ctrl-C the flights land. At the second Ctrl-C their workers are killed.
    """
    asked, deadline = 0, float("inf")
    try:
        while campaign.pending:
            campaign.poll()
            if len(stops) > asked or time.monotonic() > deadline:
                campaign.cancel(kill=bool(asked))
                asked, deadline = len(stops), time.monotonic() + _LANDING_TIMEOUT_S
    except BaseException:
        campaign.cancel(kill=False)
        raise


def _connected(address: str) -> Any:
    """Connect to the Ray cluster and return the Python package `ray`."""
    # Ray reads this variable when it is imported.
    os.environ.setdefault("RAY_gcs_server_request_timeout_seconds", str(_REQUEST_TIMEOUT_S))
    try:
        import ray
    except ImportError as error:
        raise NotInstalledError("Ray is not installed: run `pip install 'flying-arena[cluster]'`") from error
    check_address(address)
    _check_own_address(address, ray)
    before = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, configure_logging=False)
    except (ConnectionError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RunError(
            f"cannot join the Ray cluster {address} ({reason}). This computer must belong to the cluster, with the same "
            f"versions of Ray and Python: {_how_to_start(address)}"
        ) from error
    finally:
        signal.signal(signal.SIGTERM, before)
    return ray


def _how_to_start(address: str) -> str:
    head = "HOST:PORT" if address == "auto" else address
    return f"run `ray start --head` on one computer and `ray start --address={head}` on each of the others"


def check_address(address: str) -> None:
    """Check within a short time that a Ray cluster replies at this address.

    Ray itself would try for minutes.

    Raises InputError if the address has another form, RunError if no cluster answers within CONNECT_TIMEOUT_S.
    """
    address = _address_of(address)
    if not address:  # Ray looks for processes of a cluster, and reports at once if there are none
        return
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or "/" in host:
        raise InputError(
            f"cluster: got {address!r}, expected HOST:PORT as `ray start --head` prints it, or `auto`"
        )
    try:
        with socket.create_connection((host.strip("[]"), int(port)), CONNECT_TIMEOUT_S) as connection:
            answer = _answer(connection)
    except (OSError, OverflowError) as error:
        reason = str(getattr(error, "strerror", None) or error)
        raise RunError(f"no Ray cluster at {address} ({reason}): {_how_to_start(address)}") from error
    if os.environ.get("RAY_USE_TLS", "0") in ("", "0") and answer[3:4] != bytes((_SETTINGS,)):
        raise RunError(
            f"no Ray cluster at {address} (another server answers there): {_how_to_start(address)}. "
            "The usual port is 6379"
        )


def _check_own_address(address: str, ray: Any) -> None:
    """Check that a cluster at a loopback address also replies at this computer's network address, to which Ray connects.

    Without this check Ray would try for minutes.

    Raises RunError if the cluster does not reply.
    """
    host, _, port = _address_of(address).rpartition(":")
    if host.strip("[]") not in _REPLACED_HOSTS:
        return
    own = ray.util.get_node_ip_address()
    try:
        check_address(f"{own}:{port}")
    except RunError as error:
        raise RunError(
            f"the Ray cluster {host}:{port} can be reached only from this computer's loopback interface, but Ray connects to "
            f"{own}:{port}: start it with `ray start --head --node-ip-address={own}`"
        ) from error


def _address_of(address: str) -> str:
    """Return HOST:PORT of the cluster's address. For `auto` it is the cluster of this computer; "" if none was started."""
    return (os.environ.get("RAY_ADDRESS") or _read(_CURRENT_CLUSTER)) if address == "auto" else address


def _answer(connection: socket.socket) -> bytes:
    """Send an HTTP/2 greeting to a server and return the first bytes of its reply, to recognise a Ray cluster.

    Ray uses HTTP/2. The reply shows whether a Ray cluster or another server uses this address.
    """
    connection.sendall(_HTTP2_GREETING)
    return connection.recv(9)


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _check_computers(ray: Any, inputs: Mapping[str, str]) -> None:
    """Check that every computer of the cluster has the same files of the campaign and the same `arena`.

    Raises InputError with all problems, such as a missing file.
    """
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    problems = []
    check = ray.remote(num_cpus=0, max_retries=0)(problems_here)
    asked = [
        (
            f"{node['NodeManagerHostname']} ({node['NodeManagerAddress']})",
            check.options(
                scheduling_strategy=NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            ).remote(dict(inputs)),
        )
        for node in ray.nodes()
        if node["Alive"]
    ]
    for computer, one in asked:
        try:
            problems += [f"{computer}: {text}" for text in ray.get(one, timeout=_CHECK_TIMEOUT_S)]
        except ray.exceptions.GetTimeoutError:
            problems.append(f"{computer}: did not answer within {_CHECK_TIMEOUT_S:g} s")
        except ray.exceptions.RayError as error:
            problems.append(f"{computer}: {_last_line(error)}")
    if problems:
        raise InputError(
            "\n".join(dict.fromkeys(problems))
            + "\nEvery computer of the cluster needs the same arena, and the files of the campaign under the same paths"
        )


def _last_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[-1]


def _absolute(flight: Flight) -> Flight:
    """Return a copy of the flight in which the path of its arena or scenario file is absolute.

    A Ray worker has another working directory.
    """
    return replace(flight, file=str(Path(flight.file).resolve()))
