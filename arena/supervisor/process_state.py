"""The life of one supervised process, decided here and done elsewhere. Pure: no clock, no process, no file.

    STOPPED  --needs ready-->  STARTING  --proof-->  READY
    STARTING, READY  --it ended-->  BACKOFF | EXITED | FATAL        (the restart policy chooses)
    STARTING  --start time-out-->  STOPPING  --it ended-->  BACKOFF | FATAL
    STARTING, READY  --asked to stop-->  STOPPING  --it ended-->  EXITED
    READY  --asked to restart-->  STOPPING  --it ended-->  STARTING
    STARTING, READY  --stopped by a signal, READY  --silent, for too long-->  STOPPING  --it ended-->  BACKOFF | EXITED | FATAL
    BACKOFF  --waited-->  STARTING
    EXITED, FATAL  --asked to restart-->  STARTING

EXITED is an end that the restart policy accepts, whatever the exit code; FATAL means that the supervisor has given up on it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from arena.plan.model import ProcessSpec


class State(StrEnum):
    STOPPED = "STOPPED"
    STARTING = "STARTING"
    READY = "READY"
    BACKOFF = "BACKOFF"
    STOPPING = "STOPPING"
    EXITED = "EXITED"
    FATAL = "FATAL"


ALIVE = frozenset({State.STARTING, State.READY, State.STOPPING})
"""There is a process."""
WAITING = frozenset({State.STOPPED, State.BACKOFF})
"""There is none, but there may be one later without anybody asking."""
ENDED = frozenset({State.EXITED, State.FATAL})
"""There is none, and there will be none unless a person asks."""


class Action(StrEnum):
    NONE = "none"
    START = "start"
    TERMINATE = "terminate"
    KILL = "kill"


class After(StrEnum):
    """Why a process is STOPPING, and so what follows."""

    END = "end"
    RESTART = "restart"
    RETRY = "retry"


@dataclass(frozen=True, kw_only=True)
class Exit:
    """How a process ended. code: as a shell tells it, 128 + n for signal n; words: for people; ran: the exec worked."""

    code: int
    words: str
    ran: bool = True


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What the shell has seen of a process since the last step, and what is wanted of it.

    needs_ready: all it needs is there.  needs_dead: the name of a need that will never be there, or "".
    proof: how readiness was proven, or "".  exit: its end, told once.  stopped: it is there, and the kernel does not let it
    run (SIGSTOP).  silent_s: since it last told anything [s].
    starts_on: new starts are allowed (False once the run ends).
    stop: it shall end.  kill: it shall end at once.  restart: a person asked for a new start.  why: the reason for these three.
    """

    needs_ready: bool = False
    needs_dead: str = ""
    proof: str = ""
    exit: Exit | None = None
    stopped: bool = False
    silent_s: float = 0.0
    starts_on: bool = True
    stop: bool = False
    kill: bool = False
    restart: bool = False
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Life:
    """Where a process is in its life. Times are monotonic [s].

    since: of this state.  reason: why it came here.  starts: those within the restart window.  unproven: starts in a row
    that never became READY.  next_at: when BACKOFF is over, or when a STOPPING process is killed.
    stopped_at: since when a signal has stopped it, None when it runs.
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

    @property
    def restarts(self) -> int:
        return max(0, self.started - 1)


Step = tuple[Life, Action]


def step(spec: ProcessSpec, life: Life, seen: Seen, now: float) -> Step:
    """The one decision about one process at one instant. Called in every round of the loop; NONE is the usual answer."""
    if seen.exit is not None and life.state in ALIVE:
        return _ended(spec, life, seen, seen.exit, now)
    if life.state is State.STOPPING:
        return _stopping(life, seen, now)
    if life.state in ALIVE:
        return _alive(spec, life, seen, now)
    return _absent(spec, life, seen, now)


def _to(life: Life, state: State, reason: str, now: float) -> Life:
    return replace(life, state=state, since=now, reason=reason)


def _absent(spec: ProcessSpec, life: Life, seen: Seen, now: float) -> Step:
    if not seen.starts_on or seen.stop or seen.kill:
        if life.state is State.BACKOFF:
            return _to(
                life,
                State.EXITED,
                f"{_words(life)}; not started again: {seen.why or 'the run is ending'}",
                now,
            ), Action.NONE
        return life, Action.NONE
    if seen.restart:
        return _start(spec, replace(life, starts=(), unproven=0), seen.why or "restart asked", now)
    if life.state in ENDED:
        return life, Action.NONE
    if seen.needs_dead:
        return _to(life, State.FATAL, f"needs {seen.needs_dead}, which has ended for good", now), Action.NONE
    if not seen.needs_ready or (life.state is State.BACKOFF and now < life.next_at):
        return life, Action.NONE
    return _start(spec, life, "waited" if life.state is State.BACKOFF else "what it needs is ready", now)


def _start(spec: ProcessSpec, life: Life, reason: str, now: float) -> Step:
    recent = tuple(t for t in life.starts if now - t < spec.restart.window_s)
    counted = replace(
        life,
        starts=(*recent, now),
        unproven=life.unproven + 1,
        started=life.started + 1,
        exit=None,
        stopped_at=None,
    )
    return _to(counted, State.STARTING, reason, now), Action.START


def _alive(spec: ProcessSpec, life: Life, seen: Seen, now: float) -> Step:
    if seen.kill:
        return _stop(spec, life, After.END, seen.why or "killed", now, Action.KILL)
    if seen.stop:
        return _stop(spec, life, After.END, seen.why or "asked to stop", now)
    if seen.restart:
        return _stop(spec, life, After.RESTART, seen.why or "restart asked", now)
    life = _stopped(life, seen, now)
    if (
        life.stopped_at is not None
        and spec.stopped_for_s is not None
        and now - life.stopped_at >= spec.stopped_for_s
    ):
        return _stop(spec, life, After.RETRY, f"stopped for {now - life.stopped_at:.1f} s", now, Action.KILL)
    if life.state is State.READY and spec.silent_for_s is not None and seen.silent_s >= spec.silent_for_s:
        return _stop(spec, life, After.RETRY, f"told nothing for {seen.silent_s:.1f} s", now, Action.KILL)
    if life.state is State.STARTING and seen.proof:
        return replace(_to(life, State.READY, seen.proof, now), unproven=0), Action.NONE
    if life.state is State.STARTING and now - life.since >= spec.start_timeout_s:
        return _stop(spec, life, After.RETRY, f"not ready within {spec.start_timeout_s:g} s", now)
    return life, Action.NONE


def _stopped(life: Life, seen: Seen, now: float) -> Life:
    if seen.stopped == (life.stopped_at is not None):
        return life
    return replace(life, stopped_at=now if seen.stopped else None)


def _stop(
    spec: ProcessSpec, life: Life, after: After, why: str, now: float, action: Action = Action.TERMINATE
) -> Step:
    wait_s = spec.stop_timeout_s if action is Action.TERMINATE else 1.0
    return replace(_to(life, State.STOPPING, why, now), after=after, next_at=now + wait_s), action


def _stopping(life: Life, seen: Seen, now: float) -> Step:
    if seen.stop or seen.kill:
        life = replace(life, after=After.END)
    if now >= life.next_at or (seen.kill and life.next_at > now + 1.0):
        return replace(life, next_at=now + 1.0), Action.KILL
    return life, Action.NONE


def _ended(spec: ProcessSpec, life: Life, seen: Seen, exit: Exit, now: float) -> Step:
    life = replace(life, exit=exit)
    if life.state is State.STOPPING and life.after is After.END:
        return _to(life, State.EXITED, f"{exit.words} ({life.reason})", now), Action.NONE
    if life.state is State.STOPPING and life.after is After.RESTART and seen.starts_on:
        return _start(spec, replace(life, starts=(), unproven=0), life.reason, now)
    if life.state is State.STOPPING:
        return _again(spec, life, seen, f"{life.reason}, then {exit.words}", now)
    proven = exit.ran and (life.state is State.READY or spec.ready == "started")
    words = exit.words if proven or not exit.ran else f"{exit.words} before it was ready"
    accepted = spec.restart.mode == "never" or (spec.restart.mode == "on_failure" and exit.code == 0)
    if accepted and proven:
        return _to(life, State.EXITED, exit.words, now), Action.NONE
    return _again(spec, life, seen, words, now)


def _again(spec: ProcessSpec, life: Life, seen: Seen, words: str, now: float) -> Step:
    """The policy wants it to live. now: of its end."""
    if not seen.starts_on or seen.stop or seen.kill:
        return _to(life, State.EXITED, words, now), Action.NONE
    if spec.restart.mode == "never":
        return _to(life, State.FATAL, words, now), Action.NONE
    recent = tuple(t for t in life.starts if now - t < spec.restart.window_s)
    tries = max(len(recent), life.unproven)
    if tries >= spec.restart.limit:
        return _to(life, State.FATAL, f"{words}; gave up after {tries} starts", now), Action.NONE
    wait_s = float(spec.restart.backoff_s * 2.0 ** (max(tries, 1) - 1))
    waiting = replace(life, starts=recent, next_at=now + wait_s)
    return _to(waiting, State.BACKOFF, f"{words}; again in {wait_s:g} s", now), Action.NONE


def _words(life: Life) -> str:
    return life.exit.words if life.exit else life.reason
