"""The folder of one run, its private folder for sockets, and how other terminals find both.

`<runtime base>/<run>/run` holds the path of the run folder; `<run folder>/state.json` lists the running processes. It
is written before the first process starts and removed at a clean end. A run with a state.json whose supervisor has
ended is a stale run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arena.errors import RunError
from arena.plan.model import Plan, ProcessSpec
from arena.run_dirs import RUNTIME_DIR_VARIABLE, pointers, runtime_bases
from arena.supervisor import proc_fs

_SOCKET_PATH_BYTES = 107
_LONGEST_SOCKET = "/router.faults"


@dataclass(frozen=True, kw_only=True)
class Member:
    """A process as recorded in state.json.

    pid: also the number of its session.  pgid: its group.  start_s: when it started [s since boot]; pid and start time
    together identify it.
    """

    pid: int
    pgid: int
    start_s: float

    @property
    def alive(self) -> bool:
        """True while this very process runs."""
        return proc_fs.is_same(self.pid, self.start_s)


@dataclass(frozen=True, kw_only=True)
class RunState:
    """The content of state.json.

    name: of the arena.  run, rt: path of the run folder and of the runtime folder.  address: of the arena.
    boot: the kernel's boot id.  processes: name -> the running process.
    """

    name: str
    run: str
    rt: str
    address: str
    boot: str
    supervisor: Member
    processes: dict[str, Member]

    @property
    def live(self) -> bool:
        """True while its supervisor runs."""
        return self.boot == proc_fs.boot_id() and self.supervisor.alive

    @property
    def stopped(self) -> bool:
        """True while its supervisor is stopped by a signal (SIGSTOP) and does not answer."""
        return self.live and proc_fs.is_stopped(self.supervisor.pid)

    def survivors(self) -> dict[str, list[int]]:
        """Return process name -> the pids of its recorded group that still run."""
        members = self.processes if self.boot == proc_fs.boot_id() else {}
        found = {name: _still_there(member) for name, member in members.items()}
        return {name: pids for name, pids in found.items() if pids}


def _still_there(member: Member) -> list[int]:
    """Return the running processes of a recorded group.

    The leader is identified by its start time; its descendants by the session and by a later start. The kernel does not
    give the number of a group to a new process while a member of the group runs.
    """
    if proc_fs.start_time(member.pid) is not None and not (member.alive or proc_fs.is_zombie(member.pid)):
        return []
    sessions = set(proc_fs.session_members(member.pid))
    members = [pid for pid in proc_fs.group_members(member.pgid) if pid in sessions]
    return [pid for pid in members if (proc_fs.start_time(pid) or 0.0) >= member.start_s]


@dataclass(frozen=True, kw_only=True)
class RunFolder:
    """The two folders of a run.

    path: the run folder.  rt: the private runtime folder, whose path is short enough for sockets.
    """

    path: Path
    rt: Path

    @property
    def control(self) -> Path:
        """Path of the control socket."""
        return self.rt / "control.sock"

    def fill(self, text: str) -> str:
        """Replace the placeholders `{run}` and `{rt}`."""
        return text.replace("{run}", str(self.path)).replace("{rt}", str(self.rt))

    def spec(self, spec: ProcessSpec) -> ProcessSpec:
        """Return a copy of `spec` with every placeholder filled."""
        return dataclasses.replace(
            spec,
            argv=tuple(map(self.fill, spec.argv)),
            cwd=self.fill(spec.cwd),
            env=tuple((k, self.fill(v)) for k, v in spec.env),
        )

    def log(self, name: str) -> Path:
        """Return the path of a process's log."""
        return self.path / "logs" / f"{name}.log"

    def write_state(self, plan: Plan, processes: dict[str, Member]) -> None:
        """Write state.json with the processes that run now."""
        state = RunState(
            name=plan.name,
            run=str(self.path),
            rt=str(self.rt),
            address=plan.address,
            boot=proc_fs.boot_id(),
            supervisor=myself(),
            processes=processes,
        )
        write_whole(self.path / "state.json", json.dumps(dataclasses.asdict(state), indent=1))

    def close(self) -> None:
        """Remove state.json and the runtime folder, after a clean end."""
        (self.path / "state.json").unlink(missing_ok=True)
        shutil.rmtree(self.rt, ignore_errors=True)


def create(plan: Plan, runs: Path, now_s: float | None = None) -> RunFolder:
    """Make a new run folder under `runs`, and its runtime folder. now_s: wall time [s]. Raises RunError."""
    stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(now_s))
    try:
        path = _make_unique(runs.resolve(), f"{stamp}-{plan.name}")
        folder = RunFolder(path=path, rt=_free_runtime(path.name))
        for sub in ("logs", "slices", "csv", "plots"):
            (path / sub).mkdir()
        (path / "arena.yaml").write_text(plan.yaml)
        (path / "plan.json").write_text(plan.to_json())
        for name, slice_ in plan.slices.items():
            file = path / "slices" / (name if name.endswith(".json") else f"{name}.json")
            file.write_text(json.dumps(_filled(folder, slice_), indent=1))
        folder.write_state(plan, {})
        folder.rt.mkdir(mode=0o700)
        (folder.rt / "run").write_text(str(path))
    except OSError as error:
        raise RunError(f"cannot make the run folder: {error.filename or runs}: {error.strerror}") from error
    return folder


def open_run(path: Path) -> RunState | None:
    """Return the state of the run in this folder, or None when it ended cleanly or is no run."""
    try:
        raw = json.loads((path / "state.json").read_text())
        raw["supervisor"] = Member(**raw["supervisor"])
        raw["processes"] = {name: Member(**m) for name, m in raw["processes"].items()}
        return RunState(**raw)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def active_runs() -> list[RunState]:
    """Return every run of this user that has not ended cleanly, oldest first. Those with a supervisor are `live`."""
    found = []
    for pointer in pointers():
        with contextlib.suppress(OSError):
            state = open_run(Path(pointer.read_text()))
            if state is not None and state.rt == str(pointer.parent):
                found.append(state)
    return sorted(found, key=lambda state: state.supervisor.start_s)


def started_from(state: RunState) -> Path | None:
    """Return the YAML file that a run was started from, which its resolved YAML names in the first line."""
    try:
        with (Path(state.run) / "arena.yaml").open(errors="replace") as file:
            return Path(file.readline().partition("# resolved from ")[2].strip()).resolve()
    except OSError:
        return None


def plan_of(state: RunState) -> Plan | None:
    """Return the plan of a run, or None when it cannot be read."""
    try:
        return Plan.from_json((Path(state.run) / "plan.json").read_text())
    except (OSError, ValueError, TypeError, KeyError):
        return None


def myself() -> Member:
    """Return the record of this process."""
    pid = os.getpid()
    return Member(pid=pid, pgid=os.getpgid(0), start_s=proc_fs.start_time(pid) or 0.0)


def write_whole(path: Path, text: str) -> None:
    """Replace a file at once, so that a reader gets the old content or the new one, never a part."""
    half = path.with_name(path.name + ".new")
    half.write_text(text)
    half.replace(path)


def _free_runtime(name: str) -> Path:
    base = runtime_bases()[0]
    base.mkdir(mode=0o700, exist_ok=True)
    if base.stat().st_uid != os.getuid() or base.is_symlink():
        raise RunError(
            f"{base} belongs to another user: remove it, or set XDG_RUNTIME_DIR to a folder of yours"
        )
    base.chmod(0o700)
    room = _SOCKET_PATH_BYTES - len(os.fsencode(base)) - len("/-999" + _LONGEST_SOCKET)
    if room < len("20261121"):
        raise RunError(
            f"{base} is too long a path for local sockets: set {RUNTIME_DIR_VARIABLE} to a shorter one"
        )
    short = name[:room]
    return next(rt for rt in (base / f"{short}{end}" for end in _endings()) if not rt.exists())


def _make_unique(runs: Path, name: str) -> Path:
    runs.mkdir(parents=True, exist_ok=True)
    for end in _endings():
        with contextlib.suppress(FileExistsError):
            (path := runs / f"{name}{end}").mkdir()
            return path
    raise RunError(f"{runs}: 999 run folders of this second exist already: try again")


def _endings() -> list[str]:
    return ["", *(f"-{i}" for i in range(2, 1000))]


def _filled(folder: RunFolder, value: Any) -> Any:
    if isinstance(value, str):
        return folder.fill(value)
    if isinstance(value, dict):
        return {key: _filled(folder, item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_filled(folder, item) for item in value]
    return value
