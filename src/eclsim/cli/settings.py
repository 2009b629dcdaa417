"""`eclsim settings`: the smallest settings of the devices that reach a set of goals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import read_all, with_speeds
from eclsim.cli.console import INCOMPLETE, Progress, fail, warn
from eclsim.cli.destination import Destinations, hand_over, writing
from eclsim.cli.options import CaseChanges, Json, argument, option

if TYPE_CHECKING:
    from eclsim.goals.search import Reached


@dataclass(frozen=True, kw_only=True)
class SettingsOptions(CaseChanges, Json):
    """Options of `eclsim settings`."""

    case_file: str = argument(..., "CASE.toml", "Case file.")
    goal: str = option(
        ...,
        "What outputs should be, in their units, with commas between: "
        "'MAP > 65, drainage_pressure > -80, PaCO2 35..45'. Names are those of the results in JSON.",
        "--goal",
        metavar="GOALS",
    )
    vary: str | None = option(
        None,
        "What is turned, the dearest first, with or without bounds: {setting}=2000..4000,Rmc. Left out, "
        "the speed (and sweep) of the devices, over the ranges of the page.",
        metavar="NAMES",
    )


def settings(options: SettingsOptions) -> None:
    """Search for the smallest settings, such as the lowest pump speed [rpm], that reach a set of goals.

    Where goals exclude each other it says which, how near they can be had, and what would do without each.
    For research, not for treatment. Exit status: 0 all reached, 1 not, 2 bad input.
    """
    places = Destinations(force=options.force, inputs=[options.case_file])
    target = places.target("--json", options.json)
    places.check()
    (reading,) = with_speeds(read_all([options.case_file], options.settings, options.volume_policy))
    from eclsim.goals.goal import GoalError
    from eclsim.goals.search import reach
    from eclsim.orbit.status import NoDerivativesError

    try:
        with Progress() as progress:
            progress(f"searching for {options.goal}")
            result = reach(reading.case, options.goal, vary=options.vary)
    except GoalError as error:
        fail(*error.mistakes)
    except NoDerivativesError as error:
        warn([f"{reading.file}: {error.reason}"])
        raise typer.Exit(INCOMPLETE) from None
    with writing():
        if hand_over(result.as_object(), target):
            typer.echo(_text(result))
    warn(f"{reading.file}: {finding.sentence}" for finding in result.findings)
    if not result.reached:
        raise typer.Exit(INCOMPLETE)


def _text(result: Reached) -> str:
    from eclsim.outputs.registry import output
    from eclsim.reporting.numbers import number, text_table

    turned = [
        (s.name, number(v), s.unit, f"{s.low:g} to {s.high:g}")
        for s, v in zip(result.settings, result.values, strict=True)
    ]
    goals = [
        (
            str(g.goal), number(g.value), output(g.goal.output).unit,
            "yes" if g.met else "no", "yes" if g.binding else "",
        )
        for g in result.goals
    ]  # fmt: skip
    return "\n\n".join(
        (
            f"{result.id}: {result.message}",
            text_table(("setting", "value", "unit", "range"), turned, (1,)),
            text_table(("goal", "value", "unit", "reached", "binding"), goals, (1,)),
        )
    )
