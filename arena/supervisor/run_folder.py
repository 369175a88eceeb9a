"""The two folders of a run: the run folder with its results, and a private runtime folder for sockets.

Other commands find a run through the file `<runtime base>/<run>/run`, which contains the path of the run folder.
`<run folder>/state.json` lists the running processes. state.json is written before the first process starts and removed
at a clean end. A run is stale if state.json exists but its supervisor has ended.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import shutil
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from arena.background_writer import within
from arena.constants import OPEN_BRACE, RUN_FOLDER, RUNTIME_FOLDER
from arena.errors import RunError
from arena.plan.model import Plan, ProcessSpec
from arena.run_dirs import RUNTIME_DIR_VARIABLE, pointers, runtime_bases
from arena.supervisor import lab_group, proc_fs

RESTORE_TIMEOUT_S = 0.5
_SOCKET_PATH_BYTES = 107
_FILLED = re.compile("|".join(map(re.escape, (RUN_FOLDER, RUNTIME_FOLDER, OPEN_BRACE))))
_LONGEST_SOCKET = "/router.faults"


@dataclass(frozen=True, kw_only=True)
class Member:
    """Process as recorded in state.json. `pid` and `start_s` together identify the process.

    pid: process id, also the number of its session.  pgid: number of its process group.
    start_s: start time [s since boot].
    """

    pid: int
    pgid: int
    start_s: float

    @property
    def alive(self) -> bool:
        """True while the recorded process runs. False if a different process has its pid now."""
        return proc_fs.is_same(self.pid, self.start_s)


@dataclass(frozen=True, kw_only=True)
class RunState:
    """Content of state.json, which lists the running processes of one run.

    With it, `arena down` can end them without a supervisor.

    name: name of the arena.  address: IP address on which its processes open their ports.
    run: path of the run folder.  rt: path of the runtime folder.
    boot: the kernel's boot id.  processes: name -> running process.
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
        """True while the supervisor of the run exists, also if it is paused."""
        return self.boot == proc_fs.boot_id() and self.supervisor.alive

    @property
    def stopped(self) -> bool:
        """True while the supervisor of the run is paused by SIGSTOP and does not reply."""
        return self.live and proc_fs.is_stopped(self.supervisor.pid)

    def survivors(self) -> dict[str, list[int]]:
        """Return the processes of the run that still exist: name -> running pids of its process group."""
        members = self.processes if self.boot == proc_fs.boot_id() else {}
        found = {name: _still_there(member) for name, member in members.items()}
        return {name: pids for name, pids in found.items() if pids}


def _still_there(member: Member) -> list[int]:
    """Return the pids of the running processes in a process group of state.json.

    The leader is identified by its start time, its descendants by their session and a later start time. The kernel does
    not reuse the number of a group as a pid while a member of the group runs.
    """
    if proc_fs.start_time(member.pid) is not None and not (member.alive or proc_fs.is_zombie(member.pid)):
        return []
    sessions = set(proc_fs.session_members(member.pid))
    members = [pid for pid in proc_fs.group_members(member.pgid) if pid in sessions]
    return [pid for pid in members if (proc_fs.start_time(pid) or 0.0) >= member.start_s]


@dataclass(frozen=True, kw_only=True)
class RunFolder:
    """Paths of a run's two folders (run folder, runtime folder) and of the files in them.

    path: the run folder.
    rt: the private runtime folder. Its path is short enough for Unix sockets.
    """

    path: Path
    rt: Path

    @property
    def control(self) -> Path:
        """Path of the control socket."""
        return self.rt / "control.sock"

    def fill(self, text: str) -> str:
        """Replace the placeholders `{run}` and `{rt}` in a text by the paths of the run folder and the runtime folder.

        `{brace}` is replaced by `{`.
        """
        values = {RUN_FOLDER: str(self.path), RUNTIME_FOLDER: str(self.rt), OPEN_BRACE: "{"}
        return _FILLED.sub(lambda found: values[found[0]], text)

    def spec(self, spec: ProcessSpec) -> ProcessSpec:
        """Return the command, environment and limits of a process, with `{run}` and `{rt}` filled in for this run."""
        return dataclasses.replace(
            spec,
            argv=tuple(map(self.fill, spec.argv)),
            cwd=self.fill(spec.cwd),
            env=tuple((k, self.fill(v)) for k, v in spec.env),
            ready_value=self.fill(spec.ready_value) if spec.ready == "file" else spec.ready_value,
        )

    def log(self, name: str) -> Path:
        """Return the path of the log file of a process."""
        return self.path / "logs" / f"{name}.log"

    def write_state(self, plan: Plan, processes: dict[str, Member]) -> None:
        """Write state.json, which lists the running processes.

        processes: name -> record of each process that runs now.
        """
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

    def restore(self, plan: Plan) -> None:
        """Write the plan and the configuration files again if they were deleted.

        The land task and restarted processes read these files.

        Files that cannot be written are left out. Waits at most RESTORE_TIMEOUT_S for a disk that does not respond.
        """
        within(RESTORE_TIMEOUT_S, partial(self._restore, plan))

    def _restore(self, plan: Plan) -> None:
        files = {self.path / "plan.json": plan.to_json}
        for name, slice_ in plan.slices.items():
            files[_slice_path(self.path, name)] = partial(_slice_text, self, slice_)
        with contextlib.suppress(OSError):
            for file, text in files.items():
                if not file.exists():
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_text(text())
            (self.path / "logs").mkdir(exist_ok=True)

    def for_landing(self, plan: Plan) -> RunFolder:
        """Return the folder from which the land task reads plan.json: the run folder if possible.

        If plan.json cannot be restored there, it is written to the runtime folder, which is returned.
        """
        self.restore(plan)
        if (self.path / "plan.json").is_file():
            return self
        with contextlib.suppress(OSError):
            (self.rt / "plan.json").write_text(plan.to_json())
        return RunFolder(path=self.rt, rt=self.rt)

    def close(self) -> None:
        """Remove state.json and the runtime folder. Call it after a clean end of the run."""
        with contextlib.suppress(OSError):  # a read-only file system
            (self.path / "state.json").unlink(missing_ok=True)
        shutil.rmtree(self.rt, ignore_errors=True)


def create(plan: Plan, runs: Path, now_s: float | None = None) -> RunFolder:
    """Create a new run folder in `runs`, and its runtime folder.

    now_s: wall time for the name of the folder [s since epoch]; None for the current time.
    Raises RunError if a folder cannot be created, or ARENA_GROUP names no group of this user.
    """
    gid = lab_group.group_id()
    stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(now_s))
    folder = None
    try:
        runs.mkdir(parents=True, exist_ok=True)
        path = _make_unique(runs.resolve(), f"{stamp}-{plan.name}")
        folder = RunFolder(path=path, rt=_make_runtime(path.name, gid))
        for sub in ("logs", "slices", "csv"):
            (path / sub).mkdir()
        (path / "arena.yaml").write_text(plan.yaml)
        (path / "plan.json").write_text(plan.to_json())
        for name, slice_ in plan.slices.items():
            _slice_path(path, name).write_text(_slice_text(folder, slice_))
        folder.write_state(plan, {})
        (folder.rt / "run").write_text(str(path))
        (folder.rt / "plan.json").write_text(plan.to_json())  # land-all needs it if the run folder is deleted
        if gid is not None:
            lab_group.share_file(folder.rt / "run", gid)
            lab_group.share_file(folder.rt / "plan.json", gid)
            lab_group.share_folder(folder.rt, gid)
    except OSError as error:
        if folder is not None:
            shutil.rmtree(folder.rt, ignore_errors=True)
        raise RunError(f"cannot create the run folder: {error.filename or runs}: {error.strerror}") from error
    return folder


def open_run(path: Path) -> RunState | None:
    """Return the content of a run folder's state.json. Return None if the run has ended cleanly.

    Also return None if `path` is not a run folder.
    """
    try:
        raw = json.loads((path / "state.json").read_text())
        raw["supervisor"] = Member(**raw["supervisor"])
        raw["processes"] = {name: Member(**m) for name, m in raw["processes"].items()}
        return RunState(**raw)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def active_runs() -> list[RunState]:
    """Return every run of this user that has not ended cleanly, oldest first.

    Runs with a running supervisor are `live`.
    """
    found = []
    for pointer in pointers():
        with contextlib.suppress(OSError):
            state = open_run(Path(pointer.read_text()))
            if state is not None and state.rt == str(pointer.parent):
                found.append(state)
    return sorted(found, key=lambda state: state.supervisor.start_s)


def started_from(state: RunState) -> Path | None:
    """Return the path of the YAML file of a run, or None if the run folder cannot be read.

    The path is in the first line of arena.yaml in the run folder.
    """
    try:
        with (Path(state.run) / "arena.yaml").open(errors="replace") as file:
            return Path(file.readline().partition("# resolved from ")[2].strip()).resolve()
    except OSError:
        return None


def plan_of(state: RunState) -> Plan | None:
    """Return the plan of a run, or None if plan.json cannot be read."""
    try:
        return Plan.from_json((Path(state.run) / "plan.json").read_text())
    except (OSError, ValueError, TypeError, KeyError):
        return None


def myself() -> Member:
    """Return the entry of state.json for the calling process: pid, process group and start time."""
    pid = os.getpid()
    return Member(pid=pid, pgid=os.getpgid(0), start_s=proc_fs.start_time(pid) or 0.0)


def write_whole(path: Path, text: str) -> None:
    """Write a file atomically: a reader gets either the old or the new text."""
    half = path.with_name(path.name + ".new")
    half.write_text(text)
    half.replace(path)


def _make_runtime(name: str, gid: int | None) -> Path:
    base = runtime_bases(shared=gid is not None)[0]
    base.mkdir(mode=0o700, exist_ok=True)
    if base.stat().st_uid != os.getuid() or base.is_symlink():
        raise RunError(
            f"{base} belongs to another user: remove it, or set XDG_RUNTIME_DIR to a folder that you own"
        )
    if gid is not None:
        lab_group.share_folder(base, gid)
    else:  # another run may be shared with a group
        base.chmod(0o700 | (base.stat().st_mode & 0o050))
    room = _SOCKET_PATH_BYTES - len(os.fsencode(base)) - len("/-999" + _LONGEST_SOCKET)
    if room < len("20261121"):
        raise RunError(
            f"the path {base} is too long for Unix sockets: set {RUNTIME_DIR_VARIABLE} to a shorter path"
        )
    return _make_unique(base, name[:room], mode=0o700)


def _make_unique(parent: Path, name: str, *, mode: int = 0o777) -> Path:
    """Create a folder, and return its path. If the name is taken, a number is added to it.

    The folder is created without looking first, because another arena may create it at the same moment.
    """
    for end in ("", *(f"-{i}" for i in range(2, 1000))):
        with contextlib.suppress(FileExistsError):
            (path := parent / f"{name}{end}").mkdir(mode=mode)
            return path
    raise RunError(
        f"{parent}: already has 999 run folders with the current time in their names: wait 1 s and try again"
    )


def _slice_path(path: Path, name: str) -> Path:
    """Return the path of a slice, the JSON configuration file of one process.

    path: the run folder.
    name: name of the slice.
    """
    return path / "slices" / (name if name.endswith(".json") else f"{name}.json")


def _slice_text(folder: RunFolder, slice_: dict[str, Any]) -> str:
    return json.dumps(_filled(folder, slice_), indent=1)


def _filled(folder: RunFolder, value: Any) -> Any:
    if isinstance(value, str):
        return folder.fill(value)
    if isinstance(value, dict):
        return {key: _filled(folder, item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_filled(folder, item) for item in value]
    return value
