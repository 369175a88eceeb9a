"""Checks of the YAML that need the plan (the list of all processes) or tables of PX4's parameters. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from arena.errors import InputError, Problem
from arena.params.checks.findings import Finding
from arena.params.facts.failsafe_table import rc_priority_modes
from arena.params.facts.parameter_table import Version, parameter
from arena.params.generation.generate import contradictions
from arena.plan.firmware import FORWARDING_MS, px4_version, requirements, written_param_findings
from arena.schema import Arena
from arena.schema.loader import YamlPath
from arena.schema.source import near
from arena.schema.tools import Tool
from arena.vehicle_models import VEHICLE_MODELS

_SIGNS_FROM = "1.18"


def check_arena(arena: Arena, process_names: Sequence[str]) -> None:
    """Check the keys of the YAML that need the list of processes or PX4's tables, such as `needs` of a tool.

    Raises InputError with every problem found.

    process_names: names of all processes, in start order.
    """
    problems = [*_tool_needs(arena, process_names), *_program_needs(arena, process_names), *_versions(arena)]
    if not problems:
        problems += [
            *_parameters(arena),
            *_contradictions(arena),
            *_radio(arena),
            *_signing(arena),
            *_rotors(arena),
            *_vision_delay(arena),
        ]
    if problems:
        raise InputError(sorted(dict.fromkeys(problems), key=lambda p: (p.file, p.line)))


def _tool_needs(arena: Arena, process_names: Sequence[str]) -> Iterator[Problem]:
    """Find tools whose list `needs` contains a wrong name. The list names processes that must be ready first.

    The name of an unknown process is wrong, and the name of a tool that is listed later in the YAML. Therefore two tools never
    wait for each other.
    """
    before = [name for name in process_names if not name.startswith("tool.")]
    own: list[tuple[str, Tool, YamlPath]] = [
        (f"tool.{name}", tool, ("tools", name)) for name, tool in arena.tools.items()
    ]
    for v in arena.vehicles:
        own += [
            (f"tool.{v.name}.{name}", tool, arena.source.layer(v.name, "tools", name))
            for name, tool in v.tools.items()
        ]
    for process, tool, path in own:
        for need in tool.needs or ():
            if need not in before:
                later = "List this tool below the tool that it needs."
                hint = later if need in process_names else near(need, before)
                message = f"got {need!r}, expected a process that starts before this tool. {hint}"
                yield arena.source.problem((*path, "needs"), message)
        before.append(process)


def _program_needs(arena: Arena, process_names: Sequence[str]) -> Iterator[Problem]:
    """Find user programs whose list `needs` contains a wrong name. The list names tools that must be ready first.

    A name is wrong if the arena has no tool with this name. Names of other processes are wrong, too.
    """
    tools = [name for name in process_names if name.startswith("tool.")]
    for v in arena.vehicles:
        for need in v.program.needs if v.program is not None else ():
            if need not in tools:
                hint = near(need, tools) if tools else "Add it under `tools`."
                path = (*arena.source.layer(v.name, "program"), "needs")
                message = f"got {need!r}, expected the name of a tool, such as tool.bag. {hint}"
                yield arena.source.problem(path, message)


def _rotors(arena: Arena) -> Iterator[Problem]:
    """Find simulated vehicles, such as tricopters, whose rotors cannot control roll, pitch, yaw and thrust.

    The world has no servo that tilts a rotor.
    """
    for v in arena.simulated:
        model = VEHICLE_MODELS[v.profile.vehicle_class]
        if why := model.control_problem([r.as_dict() for r in v.profile.rotors]):
            path = arena.source.layer(v.name, "profile")
            yield arena.source.problem(path, f"got {v.profile.name}, but {why}.")


def _vision_delay(arena: Arena) -> Iterator[Problem]:
    """Find a motion-capture latency that is longer than EKF2 can compensate with EKF2_EV_DELAY."""
    for v in arena.simulated:
        delay_ms = requirements(arena, v).vision_delay_ms
        known = parameter("EKF2_EV_DELAY", px4_version(v))
        if delay_ms is None or known.max is None or delay_ms <= known.max or "EKF2_EV_DELAY" in v.own_params:
            continue
        message = (
            f"got {arena.mocap.latency_ms:g}, expected at most {known.max - FORWARDING_MS:g} ms: with {FORWARDING_MS:g} ms of"
            f" forwarding, EKF2_EV_DELAY of {v.name} is {delay_ms:g} ms, and PX4's limit is {known.max:g} ms"
        )
        yield arena.source.problem(("mocap", "latency_ms"), f"{message}. Use a smaller latency.")
        return


def _versions(arena: Arena) -> Iterator[Problem]:
    for v in arena.vehicles:
        try:
            px4_version(v)
        except InputError as error:
            path = arena.source.layer(v.name, "px4_version")
            yield arena.source.problem(path, f"got {v.px4_version!r}, expected a PX4 version: {error}")


def _parameters(arena: Arena) -> Iterator[Problem]:
    """Find PX4 parameters under `params` or `measured` in the YAML with a wrong name or value.

    Parameters of a `params_file` are not checked, because the file may come from another vehicle. For hardware, an unknown
    name is allowed if no known name is similar, because the PX4 build may have its own modules.
    """
    for name, _, finding in written_param_findings(arena):
        v = arena.vehicle(name)
        key = "measured" if finding.name in v.measured else "params"
        path = arena.source.layer(name, key, finding.name)
        unknown = finding.value is not None and finding.severity == "warning" and not v.simulated
        if finding.name in _LIMITS_NOT_KEPT or unknown or not arena.source.given(path):
            continue
        yield arena.source.problem(path, _sentences(finding))


def _contradictions(arena: Arena) -> Iterator[Problem]:
    """Find parameters under `params` or `measured` whose value is not the one that a failsafe of the same YAML needs.

    The parameter would win, so the vehicle would not react as the section `failsafe` says.
    """
    for v in arena.vehicles:
        for name, (needed, key) in sorted(contradictions(requirements(arena, v), px4_version(v)).items()):
            path = arena.source.layer(v.name, "measured" if name in v.measured else "params", name)
            file, line = arena.source.place(tuple(key.split(".")))
            message = (
                f"got {v.own_params[name]:g}, but {key} ({file}:{line}) needs {needed:g}. Remove one of them."
            )
            yield arena.source.problem(path, message)


def _radio(arena: Arena) -> Iterator[Problem]:
    """Find vehicles on which PX4 may ignore an RC transmitter, because of COM_RC_IN_MODE in the YAML."""
    for v in arena.vehicles:
        value, modes = v.own_params.get("COM_RC_IN_MODE"), rc_priority_modes(px4_version(v))
        if v.radio == "required" and value is not None and value not in modes:
            words = " or ".join(map(str, modes))
            message = (
                f"got {value:g}, with which PX4 may ignore the pilot's RC transmitter; expected {words}. "
                "If there is no pilot with a transmitter, write `radio: none`."
            )
            yield arena.source.problem(arena.source.layer(v.name, "params", "COM_RC_IN_MODE"), message)


def _signing(arena: Arena) -> Iterator[Problem]:
    """Find vehicles with a signing key whose PX4 version cannot sign messages."""
    for v in arena.vehicles:
        version = px4_version(v)
        if v.key_file and Version.parse(version) < Version.parse(_SIGNS_FROM):
            message = (
                f"got PX4 {version}, which does not sign messages; expected {_SIGNS_FROM} or newer. "
                f'If the vehicle has it, write `px4_version: "{_SIGNS_FROM}"`, else remove `signing`.'
            )
            yield arena.source.problem(arena.source.layer(v.name, "signing"), message)


def _sentences(finding: Finding) -> str:
    fix = finding.fix[:1].upper() + finding.fix[1:]
    expected = finding.expected
    known = finding.value is not None and expected and not expected.startswith("perhaps")
    what = f"got {finding.value:g}, expected {expected}" if known else finding.problem
    return f"{what}. {fix}{'' if fix.endswith('?') else '.'}"


# PX4 gave these enumerations more values than their stated limits
_LIMITS_NOT_KEPT = frozenset({"GF_ACTION", "COM_RC_IN_MODE"})
