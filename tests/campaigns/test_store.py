"""The folder of a campaign: complete lines survive a kill, and only one campaign writes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from arena.campaign.store import Appender, Listing, Store
from arena.errors import InputError, RunError

from .conftest import record


def test_records_are_read_back(tmp_path: Path) -> None:
    store = Store(tmp_path)
    given = [
        record("a", settings={"mass": 1.5, "w": [1, 2]}, measures={"crashes": 0.0, "tilt_max_deg": None}),
        record("b", 2, passed=False, vehicles={"uav1": {"crashes": 1.0}}),
    ]
    with store.appending() as results:
        for one in given:
            results.append(one)
            assert store.records()[one.id] == one, "on the disk at once"
    assert list(store.records().values()) == given


def test_line_cut_short_by_a_kill_is_ignored(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.appending() as results:
        results.append(record("a"))
        results.append(record("b"))
    file = tmp_path / "results.jsonl"
    file.write_bytes(file.read_bytes()[:-20])
    assert set(store.records()) == {"a"}
    with store.appending() as results:
        results.append(record("c"))
    assert set(store.records()) == {"a", "c"}


def test_later_line_replaces_an_earlier_one(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.appending() as results:
        results.append(record("a", passed=False, lost=True))
        results.append(record("a"))
    assert store.records()["a"].passed


def test_second_campaign_in_the_folder_is_refused(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom arena.campaign.store import Store\n"
        f"with Store(Path({str(tmp_path)!r})).locked():\n    print('locked', flush=True)\n    sys.stdin.read()\n"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert other.stdout is not None and other.stdout.readline() == "locked\n"
        with (
            pytest.raises(RunError, match="another `arena campaign` writes to this folder"),
            Store(tmp_path).locked(),
        ):
            pass
    finally:
        other.kill()
        other.communicate()
    with Store(tmp_path).locked():
        pass


def test_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"), Store(tmp_path / "file" / "x").locked():
        pass


def test_listing_is_read_back(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.listing() is None
    flights = [{"id": "a", "number": 1, "seed": 1, "settings": {"mass": 1.0}}]
    listing = Listing(name="n", sweep="s.yaml", kind="arena", inputs={"a.yaml": "00"}, flights=flights)
    store.write_listing(listing)
    assert store.listing() == listing and listing.settings == ("mass",)
    (tmp_path / "campaign.json").write_text("{")
    with pytest.raises(InputError, match=r"campaign\.json: cannot be read"):
        store.listing()


def test_full_disk_is_reported(tmp_path: Path) -> None:
    with (
        Path("/dev/full").open("wb", buffering=0) as full,
        pytest.raises(RunError, match="No space left on device"),
    ):
        Appender(full).append(record("a"))
    assert not Store(tmp_path).records()
