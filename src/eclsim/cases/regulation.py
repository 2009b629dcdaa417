"""The sections [regulation] and [drugs]: reflexes and infusions."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from eclsim.inputs.fields import Field, one_of, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters import regulation
from eclsim.parameters.regulation import DRUG_DOSES, MODELS, PARAMETERS


class _Settings(Section):
    """A section whose numbers are parameters of the circuit, by section and key."""

    parameters = PARAMETERS

    def values(self) -> dict[str, float]:
        """Values of the parameters that are given."""
        given = {
            f"{self.section}.{name}": value for name, value in self.model_dump(exclude_none=True).items()
        }
        return {key: value for key, value in given.items() if key in PARAMETERS}


class Regulation(_Settings):
    """Reflexes. Set points in mmHg; left out, they are the pressures of the case without regulation."""

    section = regulation.REGULATION
    baroreflex: Annotated[
        float | None,
        setting(
            PARAMETERS[regulation.GAIN], "0 to 1.2: 1 is the published reflex, less is sedation, 0 is off"
        ),
    ] = None
    model: Annotated[
        Literal["ursino1998", "heldt2004"], one_of("Published reflex", MODELS, required=False)
    ] = "ursino1998"
    set_point_mmHg: float | None = None  # noqa: N815
    venous_set_point_mmHg: float | None = None  # noqa: N815
    hypoxic_vasoconstriction: Annotated[
        float | None,
        setting(PARAMETERS[regulation.HYPOXIA], "0 to 1.5: 1 is as published; in courses with [gas]"),
    ] = None

    @property
    def open_set_points(self) -> tuple[str, ...]:
        """Set points that are wanted and not given."""
        given = {regulation.SET_POINT: self.set_point_mmHg}
        if self.model == "heldt2004":
            given[regulation.VENOUS_SET_POINT] = self.venous_set_point_mmHg
        return () if self.baroreflex is None else tuple(n for n, value in given.items() if value is None)

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Say what is without effect."""
        if "hypoxic_vasoconstriction" in values:
            message = "acts in courses of a case with [gas]; a steady beat is as without it"
            remarks.note(f"{key}.hypoxic_vasoconstriction", message)
        elif "baroreflex" not in raw:
            message = "left out, so nothing is regulated; 1 is the published reflex"
            remarks.warning(f"{key}.baroreflex", message)
        if "venous_set_point_mmHg" in values and values.get("model", "ursino1998") == "ursino1998":
            message = (
                'without effect: ursino1998 does not read right atrial pressure, model = "heldt2004" does'
            )
            remarks.warning(f"{key}.venous_set_point_mmHg", message, shown(values["venous_set_point_mmHg"]))


def _read_dose(value: object, field: Field) -> float:
    try:
        return read_number(value, field)
    except RefusedValueError as error:
        why = error.mistake
        given = float(value) if isinstance(value, int | float) else 0.0
        if field.maximum < given <= 1000.0 * field.typical:
            meant = f"{given / 1000.0:g}: {given:g} {field.unit} are {given / 1000.0:g} mg/kg/min"
            raise RefusedValueError(why.message, why.allowed, meant) from None
        raise


def _dose(drug: str) -> Field:
    parameter, unit = PARAMETERS[regulation.dose(drug)], PARAMETERS[regulation.dose(drug)].unit
    most, usual = DRUG_DOSES[drug]
    return Field(parameter.description, "number", unit, 0.0, most, usual, required=False, read=_read_dose)


class Drugs(_Settings):
    """Steady infusions in ug/kg/min, and the patient's sensitivity to each, which multiplies the dose."""

    section = regulation.DRUGS
    noradrenaline: Annotated[float, _dose("noradrenaline")] = 0.0
    dobutamine: Annotated[float, _dose("dobutamine")] = 0.0
    milrinone: Annotated[float, _dose("milrinone")] = 0.0
    nitroprusside: Annotated[float, _dose("nitroprusside")] = 0.0
    noradrenaline_sensitivity: float = 1.0
    dobutamine_sensitivity: float = 1.0
    milrinone_sensitivity: float = 1.0
    nitroprusside_sensitivity: float = 1.0

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Say where the effect of a dose is no longer that of a usual one."""
        for drug, (_, usual) in DRUG_DOSES.items():
            if values.get(drug, 0.0) > usual:
                message = f"beyond the usual {usual:g} ug/kg/min: its effect is extrapolated"
                remarks.warning(f"{key}.{drug}", message, shown(values[drug]))
