"""The key file of MAVLink signing, and the file with the last timestamp."""

import os
import stat

import pytest

from arena.errors import InputError
from arena.signing_key import SAVE_S, TimestampFile, read_key, write_new_key


def test_new_key_can_be_read_by_its_owner_only(tmp_path) -> None:
    old = os.umask(0)
    try:
        write_new_key(tmp_path / "key")
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "key").stat().st_mode) == 0o600
    assert len(read_key(tmp_path / "key")) == 32


def test_two_new_keys_differ_and_no_key_is_replaced(tmp_path) -> None:
    for name in "ab":
        write_new_key(tmp_path / name)
    a, b = read_key(tmp_path / "a"), read_key(tmp_path / "b")
    assert a != b
    with pytest.raises(InputError, match="is not replaced"):
        write_new_key(tmp_path / "a")
    assert read_key(tmp_path / "a") == a


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o666])
def test_key_that_other_users_can_use_is_refused(tmp_path, mode) -> None:
    file = tmp_path / "key"
    write_new_key(file)
    file.chmod(mode)
    with pytest.raises(InputError, match=f"mode 0{mode:o}, expected 0600.*chmod 600"):
        read_key(file)


@pytest.mark.parametrize("text", ["", "secret words", "ab" * 31, "ab" * 33, "0" * 64, "\xff" * 64])
def test_wrong_content_is_refused_and_not_repeated(tmp_path, text) -> None:
    file = tmp_path / "key"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(InputError, match="64 hexadecimal digits") as raised:
        read_key(file)
    assert not text or text not in str(raised.value)


def test_missing_key_and_folder_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_key(tmp_path / "none")
    with pytest.raises(InputError, match="is not a file"):
        read_key(tmp_path)


def test_first_timestamp_is_after_all_that_were_used(tmp_path) -> None:
    file = TimestampFile(tmp_path / "key")
    assert file.first() == 0
    file.write(1000)
    assert TimestampFile(tmp_path / "key").first() == 1000 + int(SAVE_S * 100_000)


def test_newest_timestamp_of_several_processes_is_kept(tmp_path) -> None:
    a, b = TimestampFile(tmp_path / "key"), TimestampFile(tmp_path / "key")
    a.write(2000)
    b.write(1000)
    assert a.first() == b.first() == 2000 + int(SAVE_S * 100_000)
    assert [p.name for p in tmp_path.iterdir()] == ["key.timestamp"]


def test_damaged_timestamp_file_counts_as_none(tmp_path) -> None:
    (tmp_path / "key.timestamp").write_text("x")
    assert TimestampFile(tmp_path / "key").first() == 0


def test_failed_write_is_a_problem_and_no_exception(tmp_path) -> None:
    file = TimestampFile(tmp_path / "none" / "key")
    file.write(1)
    assert "cannot be written" in file.problem
