"""Decision whether a program may run in a forked process, and what other processes see of it. Pure."""

from __future__ import annotations

import sys

import pytest

from arena.fork_server.forked_process import needs_interpreter
from arena.fork_server.process_image import packed

ENV = {"PATH": "/bin", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0", "ARENA_RUN": "/a"}


def of(folder, **changes):
    env = {key: value for key, value in {**ENV, **changes}.items() if value is not None}
    return needs_interpreter([sys.executable, str(folder / "program.py")], env, ENV)


def test_same_environment_may_be_forked(tmp_path):
    assert not of(tmp_path)


@pytest.mark.parametrize("changes", [{"ARENA_RUN": "/b"}, {"ARENA_NEW": "1"}, {"PYTHONHASHSEED": None}])
def test_variables_of_arena_and_no_hash_seed_may_be_forked(tmp_path, changes):
    assert not of(tmp_path, **changes)


@pytest.mark.parametrize(
    "changes",
    [{"OMP_NUM_THREADS": "2"}, {"PYTHONPATH": "/x"}, {"PATH": None}, {"NEW": ""}, {"PYTHONHASHSEED": "7"}],
)
def test_other_environment_needs_an_interpreter(tmp_path, changes):
    assert of(tmp_path, **changes)


@pytest.mark.parametrize("name", ["json.py", "numpy.pyc", "arena/__init__.py", "socket.so"])
def test_file_that_hides_an_imported_module_needs_an_interpreter(tmp_path, name):
    import json  # noqa: F401
    import socket  # noqa: F401

    import numpy  # noqa: F401

    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).touch()
    assert of(tmp_path)


@pytest.mark.parametrize("name", ["helpers.py", "json.txt", "json/data.csv", "sys.py"])
def test_other_files_beside_a_program_may_be_there(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).touch()
    assert not of(tmp_path)


def test_module_of_arena_is_forked_whatever_its_folder_contains(tmp_path):
    (tmp_path / "json.py").touch()
    assert not needs_interpreter([sys.executable, "-m", "arena.recorder", "x"], ENV, ENV)


def test_texts_are_packed_as_the_kernel_shows_them():
    assert packed([b"a", b"bc"], 8) == b"a\0bc\0\0\0\0"
    assert packed([b"a", b"too long", b"b"], 4) == b"a\0b\0"
    assert packed([], 2) == b"\0\0"
