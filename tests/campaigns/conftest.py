"""Fixtures of the campaign tests: a small arena, and sweep files over it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import arena
from arena.campaign.design import Flight
from arena.campaign.store import Record
from arena.campaign.sweep import Sweep, load_sweep

HOST = "127.0.0.2"  # a loopback address that Ray does not replace by the network address of this computer
ARENA = """\
world: {size: [10, 10, 4]}
defaults: {autopilot: builtin}
vehicles:
  uav1: {program: fly.py}
"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Give the address of a cluster with two nodes, one CPU core each. Skip the test without Ray."""
    pytest.importorskip("ray", reason="Ray is not installed: pip install '.[cluster]'")
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 80 * 2**20, "node_ip_address": HOST}
    paths = (Path(__file__).parents[1], Path(arena.__file__).parents[1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", ":".join(map(str, paths)))  # the workers import the test modules and arena
        cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
        cluster.add_node(**node)
    yield cluster.address
    cluster.shutdown()


@pytest.fixture
def sweep_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write a sweep file with this text, next to the arena and the program that it names."""
    (tmp_path / "arena.yaml").write_text(ARENA)
    (tmp_path / "fly.py").write_text("")

    def write(text: str) -> Path:
        path = tmp_path / "sweep.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def sweep_of(sweep_file: Callable[[str], Path]) -> Callable[[str], Sweep]:
    """Load a sweep over the small arena."""

    def load(text: str) -> Sweep:
        return load_sweep(sweep_file(f"arena: arena.yaml\n{text}"))

    return load


def record(id_: str, number: int = 1, *, passed: bool = True, **more: object) -> Record:
    """Return the record of a flight."""
    given = {"seed": 1, "settings": {}, "reasons": () if passed else ("it fell",), **more}
    return Record(id=id_, number=number, passed=passed, **given)  # type: ignore[arg-type]


def record_of(flight: Flight, **more: object) -> Record:
    """Return the record of this flight."""
    given = {"seed": flight.seed, "settings": dict(flight.settings), **more}
    return record(flight.id, flight.number, **given)  # type: ignore[arg-type]
