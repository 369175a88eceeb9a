"""Asking a person before real vehicles may arm."""

from __future__ import annotations

import sys

from arena.errors import InputError
from arena.plan.model import Plan

WORD = "yes"


def ask_consent(plan: Plan, *, yes: bool) -> None:
    """List the real vehicles and wait for the word. Returns at once where there are none.

    Raises InputError when it is not given, or when nobody is there to ask.
    """
    real = [v for v in plan.vehicles if not v.simulated]
    if not real:
        return
    programs = {
        p.vehicle: p.argv[1] if len(p.argv) > 1 else p.argv[0] for p in plan.processes if p.kind == "program"
    }
    print(f"{plan.name} flies {len(real)} real vehicle{'s' if len(real) > 1 else ''}:")
    for v in real:
        print(f"  {v.name}: system id {v.id}, {v.profile}, flown by {programs.get(v.name, 'no program')}")
    print(
        "Their programs may arm them as soon as the preflight gates hold. Is the room clear, is the pilot ready?",
        flush=True,
    )
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError(
            "real vehicles need consent, and there is no terminal to ask at: run it in one, or give --yes"
        )
    try:
        answer = input(f"Type {WORD} to go on: ")
    except EOFError:
        answer = ""
    if answer.strip() != WORD:
        raise InputError(
            f"real vehicles need consent: got {answer.strip()!r}, expected {WORD}. Nothing was started"
        )
