"""What the CRRT study asks of a case and of its options; checked before anything heavy is loaded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eclsim.cases.case import Case

AS_PUBLISHED = "as_published"
BOTH = "both"
VOLUME_POLICIES = (AS_PUBLISHED, "patient_held")
USUAL_FLOW_ML_MIN = 200.0


class StudyError(ValueError):
    """A case or an option that the study cannot be run with; says what is needed."""


def policies_of(volume_policy: str) -> tuple[str, ...]:
    """The policies that an option names."""
    if volume_policy == BOTH:
        return VOLUME_POLICIES
    if volume_policy not in VOLUME_POLICIES:
        raise StudyError(
            f"blood volume policy '{volume_policy}'; allowed: {', '.join((*VOLUME_POLICIES, BOTH))}"
        )
    return (volume_policy,)


def policy_of_cases(cases: Sequence[Case]) -> str:
    """The policy that cases of a cohort state, both where none does.

    Raises:
        StudyError: If they state different things.
    """
    result = {case.blood_volume_policy or BOTH: case.patient.id for case in cases}
    if len(result) > 1:
        text = ", ".join(f"{policy} in {name}" for policy, name in result.items())
        raise StudyError(f"the cases state different blood volume policies ({text}); choose --volume-policy")
    return next(iter(result), BOTH)


def case_speed(case: Case) -> float:
    """Pump speed of a case [rpm]; the study needs one."""
    if case.ecmo is None:
        raise StudyError(
            f"case '{case.patient.id}' has no [ecmo] section: the study connects CRRT to an ECMO circuit"
        )
    if case.ecmo.speed_rpm is None:
        raise StudyError(
            f"case '{case.patient.id}' has a roller pump: the study varies the speed of a rotary pump"
        )
    return float(case.ecmo.speed_rpm)


def check_flow(flow: float) -> None:
    """The range of flows [mL/min] is that of a case file.

    Raises:
        StudyError: Outside it.
    """
    from eclsim.devices.crrt import Crrt
    from eclsim.inputs.numbers import suspected_unit

    field = Crrt.fields()["flow_ml_min"]
    if not field.minimum <= flow <= field.maximum:
        hint = suspected_unit(flow, field.unit, field.typical, (field.minimum, field.maximum))
        meant = f"; did you mean {hint}?" if hint else ""
        raise StudyError(f"CRRT flow {flow:g} mL/min; allowed: {field.minimum:g} to {field.maximum:g}{meant}")


def crrt_flow(case: Case, wanted: float | None) -> float:
    """Blood flow of the CRRT [mL/min]: as asked for, else the case's, else 200."""
    flow = (
        wanted
        if wanted is not None
        else case.crrt.flow_ml_min
        if case.crrt is not None
        else USUAL_FLOW_ML_MIN
    )
    check_flow(flow)
    return float(flow)
