"""Commands `eclsim plan` and `eclsim settings`: fluid removal, weaning from ECMO, and settings for goals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import read_all, warn_of_new_findings, with_speeds
from eclsim.cli.console import INCOMPLETE, Progress, broken_rules, mistakes_in, note, refuse, refusing, warn
from eclsim.cli.destination import Destinations, reporting_write_errors, write_json_output
from eclsim.cli.options import CaseChanges, Json, argument, option
from eclsim.inputs.mistakes import CaseError
from eclsim.reporting.numbers import number, text_table

if TYPE_CHECKING:
    from eclsim.cases import CaseReading
    from eclsim.cli.destination import Target
    from eclsim.course.weaning import WeaningStep
    from eclsim.goals.result import Reached


@dataclass(frozen=True, kw_only=True)
class PlanOptions(CaseChanges, Json):
    """Options of `eclsim plan`."""

    case_file: str = argument(..., "CASE.toml", "Case file.")
    remove_ml: float | None = option(
        None, "Remove this volume [mL]: find the fastest net ultrafiltration.", "--remove-ml", minimum=1.0
    )
    wean: str | None = option(
        None,
        "Wean from the pump over these speeds: FIRST:LAST:STEP or a list [rpm]; of several circuits, one is "
        "named: ecmo.va=FIRST:LAST:STEP.",
        metavar="SPEEDS",
    )
    keep: str | None = option(
        None, "Goals to keep throughout: 'MAP > 60, drainage_pressure > -80, DO2 > 400'.", metavar="GOALS"
    )
    vary: str | None = option(
        None,
        "With --wean, setting that may change to keep the goals: drugs.noradrenaline=0..1. Without it, only "
        "the speeds that keep them are named.",
        metavar="NAME",
    )
    hours: float = option(72.0, "With --remove-ml, longest time allowed [h].", minimum=0.5, maximum=744.0)


def plan(options: PlanOptions) -> None:
    """Plan fluid removal or weaning.

    --remove-ml: how fast can fluid be removed without breaking a goal, up to 1.75 mL/kg/h? --wean: what will
    the bedside readings be while the pump is turned down, and which dose keeps the goals? For research, not
    for treatment. Exit status: 0 goals are kept, 1 not, 2 bad input.
    """
    mistakes = broken_rules({
        "--remove-ml, --wean: give exactly one": (options.remove_ml is None) == (options.wean is None),
        "--remove-ml needs --keep GOALS, such as 'MAP > 60, drainage_pressure > -80'":
            options.remove_ml is not None and options.keep is None,
    })  # fmt: skip
    mistakes += mistakes_in({"--wean": lambda: options.wean is None or _weaning(options.wean)})
    target, reading = _read(options, mistakes)
    if reading.case.events:
        note(["the events of the case are ignored in a plan"])
    from eclsim.goals.goal import GoalError

    with refusing(GoalError, CaseError):
        done = _remove(options, reading, target) if options.remove_ml else _wean(options, reading, target)
    if not done:
        raise typer.Exit(INCOMPLETE)


def _read(options: PlanOptions | SettingsOptions, mistakes: Sequence[str] = ()) -> tuple[Target, CaseReading]:
    """Return the JSON destination, and the case with its pump speed; exit with status 2 on errors.

    `mistakes` are further errors in the options.
    """
    places = Destinations(force=options.force, inputs=[options.case_file])
    target = places.target("--json", options.json)
    wrong = [*mistakes, *places.mistakes]
    readings = read_all([options.case_file], options.settings, options.volume_policy, wrong)
    refuse(wrong)
    return target, with_speeds(readings)[0]


def _with_case(reading: CaseReading, content: Mapping[str, object]) -> dict[str, object]:
    """Return a result for JSON, together with its case."""
    from eclsim.orbit.model import CASE, case_record

    return {"id": content["id"], CASE: case_record(reading.case), **content}


def _remove(options: PlanOptions, reading: CaseReading, target: Target) -> bool:
    from eclsim.course.removal import plan_removal

    assert options.remove_ml is not None
    assert options.keep is not None
    with Progress() as progress:
        progress(f"removing {options.remove_ml:g} mL at many rates")
        result = plan_removal(reading.case, options.remove_ml, options.keep, hours=options.hours)
    with reporting_write_errors():
        if write_json_output(_with_case(reading, result.as_object()), target):
            typer.echo(f"{result.id}: {result.message}")
    warn_of_new_findings(reading, result.warnings, f", at {result.rate_ml_h:.0f} mL/h")
    return result.possible


def _wean(options: PlanOptions, reading: CaseReading, target: Target) -> bool:
    from eclsim.course.weaning import plan_weaning

    circuit, speeds = _weaning(options.wean or "")
    with Progress() as progress:
        progress(f"weaning over {len(speeds)} speeds")
        steps = plan_weaning(reading.case, speeds, keep=options.keep, vary=options.vary, circuit=circuit)
    content = {
        "id": reading.case.patient.id, "circuit": circuit, "keep": options.keep, "vary": options.vary,
        "steps": [step._asdict() for step in steps],
    }  # fmt: skip
    with reporting_write_errors():
        if write_json_output(_with_case(reading, content), target):
            typer.echo(_table(steps, options.vary) + _kept_text(steps, options.keep))
    warn(_warnings(steps, reading.case.doubts))
    return all(step.reached for step in steps)


def _weaning(text: str) -> tuple[str | None, list[float]]:
    """Section of the circuit to wean, if it is named, and the speeds [rpm]."""
    named, equals, speeds = text.rpartition("=")
    return (named.strip().removesuffix(".speed_rpm") if equals else None), _speeds(speeds)


def _speeds(text: str) -> list[float]:
    from eclsim.devices.registry import example_setting
    from eclsim.simulation.sweep import SweepError, parse_sweep

    try:
        return [float(value) for value in parse_sweep(f"{example_setting()}={text}")[1]]
    except (SweepError, ValueError):
        allowed = "FIRST:LAST:STEP, such as 3500:1500:-500, or speeds separated by commas"
        raise ValueError(f"{text}: allowed: {allowed}") from None


def _table(steps: Sequence[WeaningStep], vary: str | None) -> str:
    from eclsim.outputs.registry import output
    from eclsim.reporting.beat_values import legend_of_marks, marks_for

    names = list(dict.fromkeys(name for step in steps for name in step.outputs))
    drug = [] if vary is None else [vary.partition("=")[0].strip()]
    head = ("speed [rpm]", *drug, *(f"{n} [{output(n).unit}]" for n in names), "")
    marks = [
        {name: marks_for(kind, name in step.doubted) for name, kind in step.marks.items() if name in names}
        for step in steps
    ]
    rows = [
        (
            number(step.speed_rpm), *([] if step.setting is None else [number(step.setting)]),
            *(number(step.outputs.get(name, math.nan)) + of_step.get(name, " ") for name in names),
            step.message,
        )
        for step, of_step in zip(steps, marks, strict=True)
    ]  # fmt: skip
    table = text_table(head, rows, tuple(range(len(head) - 1)))
    legend = legend_of_marks(mark for of_step in marks for mark in of_step.values())
    return f"{table}\n\n{legend}" if legend else table


def _kept_text(steps: Sequence[WeaningStep], keep: str | None) -> str:
    """Speeds at which the goals are kept, in words; empty without goals."""
    if keep is None:
        return ""
    kept, broken = (
        [f"{s.speed_rpm:g}" for s in steps if bool(s.reached) is reached] for reached in (True, False)
    )
    if not broken:
        where = "at every speed"
    elif not kept:
        where = "at no speed"
    else:
        where = f"at {', '.join(kept)} rpm, not at {', '.join(broken)} rpm"
    found = [(s, [*s.alarms, *["last column"] * bool(s.message)]) for s in steps if s.reached]
    alarms = [f"{step.speed_rpm:g} rpm ({', '.join(names)})" for step, names in found if names]
    but = f", but with alarms at {', '.join(alarms)}" if alarms else ""
    return f"\n\n{keep}: kept {where}{but}"


def _warnings(steps: Sequence[WeaningStep], doubts: Sequence[str]) -> list[str]:
    """Return the warnings of the beats, each at the last speed with that warning and naming the others.

    Warnings of the case itself are left out, as they were shown when it was read.
    """
    from eclsim.course.alarms import NUMBER
    from eclsim.devices.description import placed_sentence

    kinds: dict[str, list[tuple[str, str]]] = {}
    for step in steps:
        for sentence in (sentence for sentence in step.warnings if sentence not in doubts):
            kinds.setdefault(NUMBER.sub("", sentence), []).append((f"{step.speed_rpm:g}", sentence))
    lines = []
    for *before, (last, sentence) in kinds.values():
        also = f" (likewise at {', '.join(at for at, _ in before)})" if before else ""
        lines.append(placed_sentence(f"at {last} rpm{also}", sentence))
    return lines


# --- the smallest settings that reach goals ---------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SettingsOptions(CaseChanges, Json):
    """Options of `eclsim settings`."""

    case_file: str = argument(..., "CASE.toml", "Case file.")
    goal: str = option(
        ...,
        "Goals for outputs, in their units, separated by commas: "
        "'MAP > 65, drainage_pressure > -80, PaCO2 35..45'. Names are those of the results in JSON.",
        "--goal",
        metavar="GOALS",
    )
    vary: str | None = option(
        None,
        "Settings that may change, the one to spare most first, with or without bounds: "
        "{setting}=2000..4000,Rmc. Default: speed (and sweep) of the devices, over the ranges of the page.",
        metavar="NAMES",
    )


def settings(options: SettingsOptions) -> None:
    """Search for the smallest settings, such as the lowest pump speed [rpm], that reach a set of goals.

    If goals exclude each other, it shows which, how closely they can be met, and what is possible without
    each. For research, not for treatment. Exit status: 0 all reached, 1 not, 2 bad input.
    """
    target, reading = _read(options)
    from eclsim.goals.goal import GoalError
    from eclsim.goals.search import reach

    with refusing(GoalError), Progress() as progress:
        progress(f"searching for {options.goal}")
        result = reach(reading.case, options.goal, vary=options.vary)
    with reporting_write_errors():
        if write_json_output(_with_case(reading, result.as_object()), target):
            typer.echo(_text(result))
    warn_of_new_findings(reading, result.warnings)
    if reading.case.regulation is not None and reading.case.regulation.open_set_points:
        message = "reflexes act around the case as it is written: try the settings with --set"
        note([f"{options.case_file}: {message} (written into the file they would move the set points)"])
    if not result.reached:
        raise typer.Exit(INCOMPLETE)


def _text(result: Reached) -> str:
    from eclsim.outputs.registry import output

    turned = [
        (s.name, number(v), s.unit, f"{s.low:g} to {s.high:g}")
        for s, v in zip(result.settings, result.values, strict=True)
    ]
    goals = [
        (
            f"{g.goal} (by default)" if g.goal.because else str(g.goal), number(g.value),
            output(g.goal.output).unit,
            "yes" if g.met else "no", "yes" if g.binding else "",
        )
        for g in (*result.goals, *result.kept)
    ]  # fmt: skip
    settings_table = text_table(("setting", "value", "unit", "range"), turned, (1,))
    goals_table = text_table(("goal", "value", "unit", "reached", "binding"), goals, (1,))
    return f"{result.id}: {result.message}\n\n{settings_table}\n\n{goals_table}"
