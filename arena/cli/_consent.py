"""Questions that the user answers by typing a word, such as the confirmation that real vehicles may arm."""

from __future__ import annotations

import sys

from arena.errors import InputError
from arena.plan.model import Plan, ProcessSpec
from arena.supervisor.arm_permit import CONFIRMATION_S

WORD = "yes"


def ask_consent(plan: Plan, *, yes: bool) -> str:
    """List the real vehicles of a plan, and ask the user to confirm with `yes` that these vehicles may arm.

    Returns how the user has confirmed: `typed yes` or `--yes`.

    Without real vehicles, return "" and ask nothing.
    yes: option --yes: list the vehicles, but do not ask.
    Raises InputError if the user types something else, or if stdin is not a terminal.
    """
    real = [v for v in plan.vehicles if not v.simulated]
    if not real:
        return ""
    programs = {name: _program_path(plan, p) for p in plan.processes for name in p.flies}
    print(f"{plan.name} flies {len(real)} real vehicle{'s' if len(real) > 1 else ''}:")
    for v in real:
        print(f"  {v.name}: system id {v.id}, {v.profile}, flown by {programs.get(v.name, 'no program')}")
    for v in real:
        if v.radio == "none":
            print(f"  {v.name} has no pilot with an RC transmitter: nobody can take manual control")
    for v in real:
        if v.axes_check == "none":
            print(
                f"  {v.name} can arm without the identity and axes check, even if its poses are those of another rigid body or "
                "its axes are wrong. To require the check, remove `axes_check: none` from the YAML"
            )
    print(
        "Their programs can arm them as soon as the preflight checks pass. Is the room clear? Is the pilot ready?\n"
        "Your confirmation is valid for the vehicles that are connected when all processes are ready, at the latest "
        f"{CONFIRMATION_S:g} s after the start. Vehicles that connect later need `arena arm-permit`. The confirmation ends for "
        "a vehicle that is switched off or reconnected.",
        flush=True,
    )
    if yes:
        return "--yes"
    confirm(WORD, f"Type {WORD} to start: ", subject="real vehicles", consequence="Nothing was started")
    return f"typed {WORD}"


def _program_path(plan: Plan, process: ProcessSpec) -> str:
    """Return the path of the user program that a process runs."""
    if process.kind == "group":
        return str(plan.slices[f"{process.name}.json"]["program"])
    return process.argv[1] if len(process.argv) > 1 else process.argv[0]


def confirm(expected_word: str, prompt: str, *, subject: str, consequence: str) -> None:
    """Ask the user to type a word. Raise InputError for a different answer.

    Also raises InputError if stdin is not a terminal.

    subject: beginning of the error, such as "real vehicles". consequence: end of the error, such as "Nothing was started".
    """
    if not sys.stdin.isatty():
        raise InputError(
            f"{subject}: your confirmation is needed, but stdin is not a terminal: use a terminal, or add --yes"
        )
    try:
        answer = input(prompt).strip()
    except EOFError:
        answer = ""
    if answer != expected_word:
        raise InputError(
            f"{subject}: not confirmed: you typed {answer!r}, expected {expected_word}. {consequence}"
        )
