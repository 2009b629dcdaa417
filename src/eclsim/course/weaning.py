"""Weaning from ECMO: the pump is turned down step by step, and each steady beat is read at the bedside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from eclsim.cases.case import Case
from eclsim.course.timeline import case_with_settings
from eclsim.devices.device import Naming
from eclsim.devices.ecmo import ECMO
from eclsim.goals.goal import Goal, GoalError, least_flow_goals, read_goals
from eclsim.goals.result import ALARM_KINDS, broken_goals
from eclsim.goals.search import reach
from eclsim.orbit.model import CaseSource, as_case, model_of
from eclsim.outputs.alarms import doubted_outputs, marks
from eclsim.outputs.results import scalars_of, simulate
from eclsim.outputs.signals import output_names
from eclsim.simulation.target_flow import with_speed

WEANING_OUTPUTS = (
    "PF", "MAP", "CO", "LVO", "heart_rate", "ejection_fraction_lv", "PCWP", "right_atrial_pressure",
    "SaO2", "SvO2", "PaCO2", "LVOT_VTI",
)  # fmt: skip
"""Outputs of a step of weaning, where the case has them."""

NO_MARKS: Mapping[str, str] = MappingProxyType({})


class WeaningStep(NamedTuple):
    """Results for one pump speed.

    Attributes:
        speed_rpm: speed of the pump [rpm].
        setting: dose of the drug (or value of another setting) needed; None if nothing is varied.
        reached: whether the goals are reached.
        outputs: values by name of `WEANING_OUTPUTS`.
        message: explanation if a goal is not reached, no steady beat was found, or a flow exceeds a limit
            that the varied setting cannot keep.
        warnings: limits that the beat violates, and cautions about its numbers.
        marks: kind of the most severe finding about each output or waveform of the beat that has one.
        doubted: outputs that a caution concerns.
    """

    speed_rpm: float
    setting: float | None
    reached: bool
    outputs: dict[str, float]
    message: str
    warnings: tuple[str, ...] = ()
    marks: Mapping[str, str] = NO_MARKS
    doubted: tuple[str, ...] = ()

    @property
    def alarms(self) -> tuple[str, ...]:
        """Outputs and waveforms that violate an alarm limit, or of a vein or chamber that collapses."""
        return tuple(name for name, kind in self.marks.items() if kind in ALARM_KINDS)


def plan_weaning(
    case: CaseSource,
    speeds: Sequence[float],
    *,
    keep: str | Sequence[str | Goal] | None = None,
    vary: str | None = None,
    volume_policy: str | None = None,
    circuit: str | None = None,
) -> list[WeaningStep]:
    """Reduce the pump speed step by step, with the reflex of the case, and read each steady beat.

    Args:
        case: path of a case file, what `read_case` returned, or a case with ECMO.
        speeds: speeds of the pump in order [rpm].
        keep: goals for every speed, such as "MAP > 65".
        vary: setting varied to reach them, such as "drugs.noradrenaline=0..1"; the smallest value is sought.
            If None, goals are only checked at each speed.
        volume_policy: blood volume policy; None takes that of the case.
        circuit: section of the circuit to wean, such as "ecmo.va", of a case with several; the others stay as
            they are.

    Raises:
        GoalError: Goals or settings are not possible, or the case has no ECMO, or several and none is named.
        CaseError: The file is no case, or a speed is not allowed.
    """
    start = with_speed(as_case(case), volume_policy)[0].model_copy(update={"events": ()})
    names = _circuit_to_wean(start, circuit)
    numbers = _speeds(speeds)
    if keep is None and vary is not None:
        raise GoalError([f"vary '{vary}': needs goals to keep, such as MAP > 65; none is given"])
    if vary is not None and "," in vary:
        raise GoalError([f"vary '{vary}': one setting is sought at each speed; allowed: NAME=LOW..HIGH"])
    if vary is not None and vary.strip().startswith("drugs.") and start.drugs is None:
        start = case_with_settings(start, {vary.partition("=")[0].strip(): 0.0}, start)
    key = f"{names.key}.speed_rpm"
    slowed = [(case_with_settings(start, {key: speed}, start), speed) for speed in numbers]
    if keep is None or vary is None:
        steps = [_checked_step(at_speed, speed, keep, volume_policy) for at_speed, speed in slowed]
    else:
        steps = [_searched_step(at_speed, speed, keep, vary, volume_policy) for at_speed, speed in slowed]
    read = _outputs_of_weaning(start, names)
    return [step._replace(outputs={n: step.outputs[n] for n in read if n in step.outputs}) for step in steps]


def _circuits(case: Case) -> dict[str, Naming]:
    """ECMO circuits of a case by section."""
    return {one.key: one for one in case.instances() if one.device.key == ECMO.key}


def _circuit_to_wean(case: Case, wanted: str | None) -> Naming:
    """The circuit whose pump is turned down: the one that is named, or the only one."""
    circuits = _circuits(case)
    if not circuits:
        raise GoalError([f"no ECMO to wean from; allowed: a case with [{ECMO.key}]"])
    if wanted is None and len(circuits) == 1:
        return next(iter(circuits.values()))
    if wanted in circuits:
        return circuits[wanted]
    allowed, example = ", ".join(circuits), next(iter(circuits))
    if wanted is not None:
        raise GoalError([f"circuit to wean {wanted!r}: not in this case; allowed: {allowed}"])
    raise GoalError([
        f"this case has several ECMO circuits: say which one to wean, such as "
        f"--wean {example}=3000:1500:-500; allowed: {allowed}"
    ])  # fmt: skip


def _outputs_of_weaning(case: Case, weaned: Naming) -> list[str]:
    """`WEANING_OUTPUTS`, with the flow of each circuit, that of the one that is weaned first."""
    others = [one for key, one in _circuits(case).items() if key != weaned.key]
    flows = [one.output("PF") for one in (weaned, *others)]
    return [*flows, *(name for name in WEANING_OUTPUTS if name != "PF")]


def _speeds(given: Sequence[float]) -> list[float]:
    """Return the speeds as numbers [rpm]."""
    try:
        speeds = [] if isinstance(given, str) else [float(speed) for speed in given]
    except (TypeError, ValueError):
        speeds = []
    if not speeds:
        raise GoalError([f"speeds {given!r}: allowed: numbers [rpm] in order, such as [3000, 2000, 1000]"])
    return speeds


def _checked_step(
    case: Case, speed: float, keep: str | Sequence[str | Goal] | None, policy: str | None
) -> WeaningStep:
    """Step with the case as it is: its beat, and which goals it keeps."""
    names, values = output_names(model_of(case).circuit), model_of(case).values
    goals = () if keep is None else read_goals(keep, names)
    flows = () if keep is None else least_flow_goals(names, goals, values)
    result = simulate(case, policy)
    numbers = {name: float(result[name]) for name in scalars_of(result)}
    lost = not result.attrs["converged"] or bool(goals and result.attrs["one_of_many"])
    missed = list(broken_goals(numbers, goals))
    message = "; ".join(one.sentence for one in (*missed, *broken_goals(numbers, flows)))
    found = {str(name): entry.attrs.get("finding") for name, entry in result.items()}
    kinds = {name: kind for name, kind in found.items() if kind}
    return WeaningStep(
        speed, None, not missed and not lost, numbers,
        str(result.attrs["message"]) if lost else message, tuple(result.attrs["warnings"]), kinds,
        tuple(name for name in kinds if result[name].attrs["read_with_care"]),
    )  # fmt: skip


def _searched_step(
    case: Case, speed: float, keep: str | Sequence[str | Goal], vary: str, policy: str | None
) -> WeaningStep:
    """Step with the smallest value of the varied setting that keeps the goals."""
    result = reach(case, keep, vary=vary, volume_policy=policy)
    alarms = "; ".join(alarm.sentence for alarm in result.not_kept)
    return WeaningStep(
        speed, result.values[0], result.reached, dict(result.outputs),
        alarms if result.reached else result.message, result.warnings,
        marks(result.findings, result.outputs, model_of(case).values), doubted_outputs(result.findings),
    )  # fmt: skip
