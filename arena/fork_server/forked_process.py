"""Runs a program in a process that the fork server has forked, as a new Python interpreter would run it.

The process has the session, priority, output, environment, `sys.argv`, `sys.path[0]` and `__main__` that an interpreter would have.
If the packages that the fork server has imported could change what the program does, the process executes the interpreter instead.
"""

from __future__ import annotations

import contextlib
import gc
import importlib.util
import os
import socket
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.machinery import SourceFileLoader, all_suffixes
from pathlib import Path
from types import CodeType, ModuleType

from arena.fork_server.process_image import show
from arena.preloaded import OtherWork
from arena.process_ties import set_death_signal

DESCRIPTORS = 3
_AUTOGROUP = Path("/proc/self/autogroup")
_OWN_PREFIX = "ARENA_"
_HASH_SEED = "PYTHONHASHSEED"
_THRESHOLDS = gc.get_threshold()


@dataclass(frozen=True, kw_only=True)
class Request:
    """Request to the fork server to start a program in a forked process.

    It comes from a client, such as the supervisor.

    argv: command line: the interpreter, then `-m MODULE` or the file of a program, then arguments.
    cwd: working folder.
    env: complete environment.
    socket_variable: environment variable for the number of the socket to the client.
    nice: added to the nice value of the client.
    death_signal: signal that the process gets when the client dies; 0: none.
    client: pid of the client.
    """

    argv: list[str]
    cwd: str
    env: dict[str, str]
    socket_variable: str
    nice: int
    death_signal: int
    client: int


_ENVIRONMENT: dict[str, str] = {}
"""Environment in which the packages of this process were imported."""


def remember_environment() -> None:
    """Store the environment variables of the fork server, before packages that read them are imported.

    Copies of the server have it, too.
    """
    _ENVIRONMENT.update(os.environ)


def start_work(request: Request, output: int, go: int, channel: int | None = None) -> Callable[[], int]:
    """Prepare a forked process for its program. Return the function that runs the program.

    The program starts only after the client has sent `go`.

    output, go, channel: file descriptors, as in the package's `__main__`. Ends the process if `go` is closed.
    """
    os.setsid()
    nowhere = os.open(os.devnull, os.O_RDONLY)
    for descriptor, number in ((nowhere, 0), (output, 1), (output, 2)):
        os.dup2(descriptor, number)
    for descriptor in (nowhere, output):
        os.close(descriptor)
    with socket.socket(fileno=go) as waiting:
        if waiting.recv(1) != b"1":
            os._exit(1)
    if request.death_signal:
        set_death_signal(request.death_signal)
        if os.getppid() != request.client:  # it died before the call above
            os._exit(1)
    _set_priority(request.nice)
    os.chdir(request.cwd)
    env = dict(request.env)
    if channel is not None:
        os.set_inheritable(channel, True)
        env[request.socket_variable] = str(channel)
    program = None if needs_interpreter(request.argv, env, _ENVIRONMENT) else _program(request.argv)
    os.environ.clear()
    os.environ.update(env)
    if program is None:
        os.execve(request.argv[0], request.argv, env)
    show(_visible(request.argv), env)
    gc.set_threshold(*_THRESHOLDS)
    _reseed()
    return partial(_run, program, request.argv)


def _visible(argv: list[str]) -> list[str]:
    """Return the command line to show in /proc; [] for arena's own processes, which set a process title."""
    return [] if argv[1] == "-m" and "setproctitle" in sys.modules else argv


def _set_priority(nice: int) -> None:
    """Add `nice` to the nice value of this process. Its session (autogroup) gets the same nice value.

    With autogroups the kernel gives every session an equal share of the CPU: nice values have no effect between sessions.
    """
    with contextlib.suppress(OSError):
        os.nice(nice)
    if found := os.getpriority(os.PRIO_PROCESS, 0):
        with contextlib.suppress(OSError):
            _AUTOGROUP.write_text(str(found))


def needs_interpreter(argv: list[str], env: Mapping[str, str], own: Mapping[str, str]) -> bool:
    """Return whether a program must run in a new Python interpreter, and not in a forked process.

    This is so if its environment differs from that of the fork server in more than arena's variables, because packages read the
    environment when they are imported; or if a file beside the program would be imported instead of a module that is already imported.
    own: environment of the fork server.
    """
    if env.get(_HASH_SEED, "random") not in ("random", own.get(_HASH_SEED)):
        return True
    if _foreign(env) != _foreign(own):
        return True
    return argv[1] != "-m" and bool(_importable(Path(argv[1]).parent) & _imported())


def _foreign(env: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in env.items() if not key.startswith(_OWN_PREFIX) and key != _HASH_SEED}


def _importable(folder: Path) -> set[str]:
    """Return the names of the Python modules and packages in a folder."""
    found = set()
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path.is_dir() and (path / "__init__.py").exists():
                found.add(path.name)
            elif (suffix := next(filter(path.name.endswith, all_suffixes()), "")) != "":
                found.add(path.name.removesuffix(suffix).partition(".")[0])
    return found


def _imported() -> set[str]:
    return {name.partition(".")[0] for name in sys.modules} - {"__main__", *sys.builtin_module_names}


def _program(argv: list[str]) -> tuple[CodeType, ModuleType] | None:
    """Load a program: return its compiled code and its module `__main__`; None if it cannot be loaded.

    A new interpreter then reports the error.
    """
    main = ModuleType("__main__")
    main.__dict__.update(__builtins__=__builtins__, __annotations__={})
    try:
        if argv[1] == "-m":
            name, spec = argv[2], importlib.util.find_spec(argv[2])
            if spec is not None and spec.submodule_search_locations is not None:
                name = f"{name}.__main__"
                spec = importlib.util.find_spec(name)
            if spec is None or not isinstance(spec.loader, SourceFileLoader):
                return None
            code = spec.loader.get_code(name)
            main.__file__, main.__spec__, main.__package__ = spec.origin, spec, spec.parent
            main.__loader__ = spec.loader
        else:
            code = compile(Path(argv[1]).read_bytes(), argv[1], "exec", dont_inherit=True)
            main.__dict__.update(__file__=argv[1], __cached__=None)
            main.__loader__ = SourceFileLoader("__main__", argv[1])
    except (ImportError, OSError, SyntaxError, ValueError):
        return None
    return None if code is None else (code, main)


def _run(program: tuple[CodeType, ModuleType], argv: list[str]) -> int:
    """Run a program as the Python interpreter does, and return its exit code.

    Raise SystemExit or KeyboardInterrupt if the program raised it.
    """
    code, main = program
    file = str(main.__file__)
    sys.modules["__main__"] = main
    sys.orig_argv[:] = argv
    if argv[1] == "-m":
        sys.argv[:], sys.path[0] = [file, *argv[3:]], str(Path.cwd())
    else:
        sys.argv[:], sys.path[0] = argv[1:], str(Path(file).resolve().parent)
    try:
        exec(code, main.__dict__)
    except SystemExit:
        raise
    except OtherWork as other:
        work = other.work
    except BaseException as error:
        trace = error.__traceback__.tb_next if error.__traceback__ is not None else None
        sys.excepthook(type(error), error.with_traceback(trace), trace)
        if isinstance(error, KeyboardInterrupt):
            sys.excepthook = lambda *_: None  # it is printed; the interpreter ends the process by SIGINT
            raise
        return 1
    else:
        return 0
    return work()


def _reseed() -> None:
    """Give numpy's global random generator a new seed, as in a new interpreter.

    Python's `random` does so at each fork.
    """
    if "numpy.random" in sys.modules:
        sys.modules["numpy.random"].seed()
