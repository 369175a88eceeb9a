"""State machine of one supervised process. Pure: no clock, no process, no file.

    STOPPED  --required processes ready-->  STARTING  --proof that it is ready-->  READY
    STARTING, READY  --ended-->  BACKOFF | EXITED | FATAL        (the restart policy chooses)
    STARTING  --start time-out-->  STOPPING  --ended-->  BACKOFF | FATAL
    STARTING, READY  --stop requested-->  STOPPING  --ended-->  EXITED
    READY  --restart requested-->  STOPPING  --ended-->  STARTING
    STARTING, READY  --paused by a signal for too long-->  STOPPING  --ended-->  BACKOFF | EXITED | FATAL
    READY  --no packet for too long-->  STOPPING  --ended-->  BACKOFF | EXITED | FATAL
    BACKOFF  --backoff time over-->  STARTING
    EXITED, FATAL  --restart requested-->  STARTING

EXITED: the process ended and the restart policy accepts this. The exit code may be any.
FATAL: the process failed and the supervisor does not restart it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from arena.plan.model import ProcessSpec


class State(StrEnum):
    """State of a supervised process."""

    STOPPED = "STOPPED"
    STARTING = "STARTING"
    READY = "READY"
    BACKOFF = "BACKOFF"
    STOPPING = "STOPPING"
    EXITED = "EXITED"
    FATAL = "FATAL"


ALIVE = frozenset({State.STARTING, State.READY, State.STOPPING})
"""States in which the operating system process exists."""
WAITING = frozenset({State.STOPPED, State.BACKOFF})
"""States without an operating system process; the supervisor may start one later by itself."""
ENDED = frozenset({State.EXITED, State.FATAL})
"""States without an operating system process; only `arena restart` starts one."""


class Action(StrEnum):
    """Action that the main loop must carry out on a process, such as start or kill."""

    NONE = "none"
    START = "start"
    TERMINATE = "terminate"
    KILL = "kill"


class After(StrEnum):
    """Plan for a process after its stop: leave it ended, restart it now, or retry it later."""

    END = "end"
    RESTART = "restart"
    RETRY = "retry"


@dataclass(frozen=True, kw_only=True)
class Exit:
    """Exit of a process: its exit code or signal, and a text.

    code: exit code as a shell reports it; 128 + n for signal n.
    text: for people, such as `exit 1`.
    ran: false if the executable could not be started.
    last_line: last non-blank line that a failed process printed, since it was started. It usually names the cause.
    """

    code: int
    text: str
    ran: bool = True
    last_line: str = ""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Input of the state machine (`step`): what happened to a process since the last step, and what is requested.

    needs_ready: all processes that it needs (`ProcessSpec.needs`) are ready.
    needs_dead: name of a needed process that has ended and will not be restarted, or "".
    proof: text that says how the process has shown that it is ready, or "".
    exit: how the process ended; set in one step only.
    stopped: the process is paused by a signal (SIGSTOP).
    silent_s: time since its last packet [s].
    starts_on: new starts are allowed (False once the run ends, except for processes that serve a landing vehicle).
    hold: a real vehicle that the process serves is armed. A process that continues after its stop signal is then not killed.
    armed: a real vehicle that the user program in the process flies is armed.
    stop: terminate the process.  kill: kill it at once.  restart: start it again.
    why: the reason for stop, kill or restart.
    """

    needs_ready: bool = False
    needs_dead: str = ""
    proof: str = ""
    exit: Exit | None = None
    stopped: bool = False
    silent_s: float = 0.0
    starts_on: bool = True
    hold: bool = False
    armed: bool = False
    stop: bool = False
    kill: bool = False
    restart: bool = False
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class ProcessStatus:
    """State of a process with its history. Times are monotonic [s].

    since: time when the process entered this state.  reason: why it entered this state.
    starts: times of the starts within the restart window.  started: number of all starts.
    unproven: number of consecutive starts that never became READY.
    next_at: in BACKOFF the time of the next start, in STOPPING the time of SIGKILL.
    after: what follows STOPPING.  exit: how the process ended last.
    stopped_at: when a signal (SIGSTOP) paused it; None if it is not paused.
    armed: a real vehicle of this user program was armed since the last start. Then only `arena restart` starts the program
        again: after a landing it could arm the vehicle again, while somebody walks to it.
    """

    state: State = State.STOPPED
    since: float = 0.0
    reason: str = "not started yet"
    starts: tuple[float, ...] = ()
    unproven: int = 0
    started: int = 0
    next_at: float = 0.0
    after: After = After.END
    exit: Exit | None = None
    stopped_at: float | None = None
    armed: bool = False

    @property
    def restarts(self) -> int:
        """Number of starts after the first start."""
        return max(0, self.started - 1)


Step = tuple[ProcessStatus, Action]

_WAS_ARMED = "; not started again, because its real vehicle was armed, or may have been. Only `arena restart` starts it"


def step(spec: ProcessSpec, status: ProcessStatus, observation: Observation, now: float) -> Step:
    """Advance the state machine of a process. Return its new status and the action to carry out.

    now: monotonic [s].
    """
    if observation.armed and status.state in ALIVE | {State.BACKOFF}:
        status = replace(status, armed=True)
    if observation.exit is not None and status.state in ALIVE:
        return _ended(spec, status, observation, observation.exit, now)
    if status.state is State.STOPPING:
        return _stopping(status, observation, now)
    if status.state in ALIVE:
        return _alive(spec, status, observation, now)
    return _absent(spec, status, observation, now)


def _to(status: ProcessStatus, state: State, reason: str, now: float) -> ProcessStatus:
    return replace(status, state=state, since=now, reason=reason)


def _absent(spec: ProcessSpec, status: ProcessStatus, observation: Observation, now: float) -> Step:
    if not observation.starts_on or observation.stop or observation.kill:
        if status.state is State.BACKOFF:
            return _to(
                status,
                State.EXITED,
                f"{_exit_text(status)}; not started again: {observation.why or 'the run is ending'}",
                now,
            ), Action.NONE
        return status, Action.NONE
    if observation.restart:
        return _start(
            spec, replace(status, starts=(), unproven=0), observation.why or "restart requested", now
        )
    if status.state in ENDED:
        return status, Action.NONE
    if status.state is State.BACKOFF and status.armed:
        return _to(status, State.FATAL, f"{_exit_text(status)}{_WAS_ARMED}", now), Action.NONE
    if observation.needs_dead:
        return _to(
            status, State.FATAL, f"needs {observation.needs_dead}, which has ended and is not restarted", now
        ), Action.NONE
    if not observation.needs_ready or (status.state is State.BACKOFF and now < status.next_at):
        return status, Action.NONE
    return _start(
        spec, status, "backoff is over" if status.state is State.BACKOFF else "its needs are ready", now
    )


def _start(spec: ProcessSpec, status: ProcessStatus, reason: str, now: float) -> Step:
    recent = tuple(t for t in status.starts if now - t < spec.restart.window_s)
    counted = replace(
        status,
        starts=(*recent, now),
        unproven=status.unproven + 1,
        started=status.started + 1,
        exit=None,
        stopped_at=None,
        armed=False,
    )
    return _to(counted, State.STARTING, reason, now), Action.START


def _alive(spec: ProcessSpec, status: ProcessStatus, observation: Observation, now: float) -> Step:
    if observation.kill:
        return _stop(spec, status, After.END, observation.why or "killed", now, Action.KILL)
    if observation.stop:
        return _stop(spec, status, After.END, observation.why or "stop requested", now)
    if observation.restart:
        # A process that serves an armed real vehicle would not end on the stop signal.
        action = Action.KILL if observation.hold else Action.TERMINATE
        return _stop(spec, status, After.RESTART, observation.why or "restart requested", now, action)
    status = _stopped(status, observation, now)
    if (
        status.stopped_at is not None
        and spec.stopped_for_s is not None
        and now - status.stopped_at >= spec.stopped_for_s
    ):
        return _stop(
            spec, status, After.RETRY, f"paused for {now - status.stopped_at:.1f} s", now, Action.KILL
        )
    if (
        status.state is State.READY
        and spec.silent_for_s is not None
        and observation.silent_s >= spec.silent_for_s
    ):
        return _stop(
            spec, status, After.RETRY, f"sent nothing for {observation.silent_s:.1f} s", now, Action.KILL
        )
    if status.state is State.STARTING and observation.proof:
        return replace(_to(status, State.READY, observation.proof, now), unproven=0), Action.NONE
    if status.state is State.STARTING and now - status.since >= spec.start_timeout_s:
        return _stop(spec, status, After.RETRY, f"not ready within {spec.start_timeout_s:g} s", now)
    return status, Action.NONE


def _stopped(status: ProcessStatus, observation: Observation, now: float) -> ProcessStatus:
    if observation.stopped == (status.stopped_at is not None):
        return status
    return replace(status, stopped_at=now if observation.stopped else None)


def _stop(
    spec: ProcessSpec,
    status: ProcessStatus,
    after: After,
    why: str,
    now: float,
    action: Action = Action.TERMINATE,
) -> Step:
    wait_s = spec.stop_timeout_s if action is Action.TERMINATE else 1.0
    return replace(_to(status, State.STOPPING, why, now), after=after, next_at=now + wait_s), action


def _stopping(status: ProcessStatus, observation: Observation, now: float) -> Step:
    if observation.stop or observation.kill:
        status = replace(status, after=After.END)
    if observation.hold and status.after is After.END and not observation.kill:
        return status, Action.NONE
    if now >= status.next_at or (observation.kill and status.next_at > now + 1.0):
        return replace(status, next_at=now + 1.0), Action.KILL
    return status, Action.NONE


def _ended(
    spec: ProcessSpec, status: ProcessStatus, observation: Observation, exit: Exit, now: float
) -> Step:
    proof = (
        status.state is State.STARTING and observation.proof != ""
    )  # it became ready and ended within one round
    status = replace(status, exit=exit, unproven=0 if proof else status.unproven)
    if status.state is State.STOPPING and status.after is After.END:
        return _to(status, State.EXITED, f"{exit.text} ({status.reason})", now), Action.NONE
    if status.state is State.STOPPING and status.after is After.RESTART and observation.starts_on:
        return _start(spec, replace(status, starts=(), unproven=0), status.reason, now)
    if status.state is State.STOPPING:
        return _again(spec, status, observation, f"{status.reason}, then {exit.text}", now)
    proven = exit.ran and (status.state is State.READY or proof or spec.ready == "started")
    words = exit.text if proven or not exit.ran else f"{exit.text} before it was ready"
    accepted = spec.restart.mode == "never" or (spec.restart.mode == "on_failure" and exit.code == 0)
    if accepted and proven:
        return _to(status, State.EXITED, exit.text, now), Action.NONE
    return _again(spec, status, observation, words, now)


def _again(
    spec: ProcessSpec, status: ProcessStatus, observation: Observation, words: str, now: float
) -> Step:
    """Return the next status of a process that has ended: BACKOFF (restart later), FATAL or EXITED.

    It is FATAL after too many starts, if the process is never restarted, or if it has flown a real vehicle. It is EXITED if the
    run ends or a stop was requested.

    words: how it ended.  now: monotonic [s].
    """
    if not observation.starts_on or observation.stop or observation.kill:
        return _to(status, State.EXITED, words, now), Action.NONE
    if spec.restart.mode == "never":
        return _to(status, State.FATAL, words, now), Action.NONE
    if status.armed:
        return _to(status, State.FATAL, f"{words}{_WAS_ARMED}", now), Action.NONE
    recent = tuple(t for t in status.starts if now - t < spec.restart.window_s)
    tries = max(len(recent), status.unproven)
    if tries >= spec.restart.limit:
        return _to(status, State.FATAL, f"{words}; gave up after {tries} starts", now), Action.NONE
    wait_s = float(spec.restart.backoff_s * 2.0 ** (max(tries, 1) - 1))
    waiting = replace(status, starts=recent, next_at=now + wait_s)
    return _to(waiting, State.BACKOFF, f"{words}; again in {wait_s:g} s", now), Action.NONE


def _exit_text(status: ProcessStatus) -> str:
    return status.exit.text if status.exit else status.reason
