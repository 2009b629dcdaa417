"""Sections [regulation] and [drugs]: reflexes and infusions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from eclsim.inputs.fields import Field, one_of, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters import regulation
from eclsim.parameters.regulation import DRUG_DOSES, MODELS, PARAMETERS

GAS_RESPONSES = tuple(key.rpartition(".")[2] for key in regulation.GAS_RESPONSES)
"""Keys of the responses to dissolved gases, which need a section [gas]."""


class _Settings(Section):
    """A section whose numbers are parameters of the circuit, by section and key."""

    parameters = PARAMETERS

    def values(self) -> dict[str, float]:
        """Return the values of the parameters that are given."""
        stated = {
            f"{self.section}.{name}": value for name, value in self.model_dump(exclude_none=True).items()
        }
        return {key: value for key, value in stated.items() if key in PARAMETERS}


class Regulation(_Settings):
    """Reflexes. Set points not given are those of the case without regulation; pressures in mmHg."""

    section = regulation.REGULATION
    baroreflex: Annotated[
        float | None,
        setting(
            PARAMETERS[regulation.GAIN], "0 to 1.2: 1 is the published reflex, less is sedation, 0 is off"
        ),
    ] = None
    model: Annotated[
        Literal["ursino1998", "heldt2004", "heldt2010"], one_of("Published reflex", MODELS, required=False)
    ] = "ursino1998"
    set_point_mmHg: float | None = None  # noqa: N815
    venous_set_point_mmHg: float | None = None  # noqa: N815
    heart_rate_response: Annotated[
        float | None,
        setting(
            PARAMETERS[regulation.HEART_RATE_RESPONSE], "0 to 1: 1 is a healthy sinus node, 0 a paced heart"
        ),
    ] = None
    hypoxic_vasoconstriction: Annotated[
        float | None, setting(PARAMETERS[regulation.HYPOXIA], "0 to 1.5: 1 is as published; with [gas]")
    ] = None
    chemoreflex: Annotated[
        float | None, setting(PARAMETERS[regulation.CHEMOREFLEX], "0 to 1.2: 1 is as published; with [gas]")
    ] = None
    hypoxic_vasodilation: Annotated[
        float | None, setting(PARAMETERS[regulation.DILATION], "0 to 1.5: 1 is as published; with [gas]")
    ] = None
    carbon_dioxide_response: Annotated[
        float | None,
        setting(PARAMETERS[regulation.CARBON_DIOXIDE], "0 to 1: 1 is as measured in patients; with [gas]"),
    ] = None
    set_point_pao2_mmHg: float | None = None  # noqa: N815
    set_point_paco2_mmHg: float | None = None  # noqa: N815
    lower_set_point_paco2_mmHg: float | None = None  # noqa: N815
    set_point_venous_o2_ml_dl: float | None = None
    upper_set_point_venous_o2_ml_dl: float | None = None
    lower_set_point_venous_o2_ml_dl: float | None = None
    hypoxic_resistance_at_rest: float | None = None

    @property
    def open_set_points(self) -> tuple[str, ...]:
        """Set points that are needed but not given."""
        required: list[str] = []
        if self.baroreflex is not None:
            required += [regulation.SET_POINT]
            required += [regulation.VENOUS_SET_POINT] if self.model != "ursino1998" else []
        if self.chemoreflex is not None:
            required += regulation.CHEMOREFLEX_SET_POINTS
        if self.hypoxic_vasodilation is not None:
            required += regulation.DILATION_SET_POINTS
        if self.carbon_dioxide_response is not None:
            required += map(regulation.paco2_set_point, regulation.BEDS)
        if self.hypoxic_vasoconstriction is not None:
            required += [regulation.LUNG_AT_REST]
        stated = self.values()
        return tuple(name for name in dict.fromkeys(required) if name not in stated)

    def values(self) -> dict[str, float]:
        """Return the given parameter values; a set point given for all organs also applies to each region."""
        stated = super().values()
        for key in (regulation.PACO2_SET_POINT, regulation.VENOUS_O2_SET_POINT):
            stated |= {
                name: stated.get(name, stated[key])
                for bed in regulation.BEDS
                if key in stated and (name := regulation.of_bed(key, bed)) in PARAMETERS
            }
        without_baroreflex = self.chemoreflex is not None and self.baroreflex is None
        return stated | ({regulation.GAIN: 0.0} if without_baroreflex else {})

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Warn of keys without effect, and refuse contradictory ones."""
        if "chemoreflex" in values and values.get("model", "ursino1998") != "ursino1998":
            message = f"acts on the firing rate of nerves, which {values['model']} does not model"
            remarks.error(f"{key}.chemoreflex", message, shown(values["chemoreflex"]), 'model = "ursino1998"')
        others = (*GAS_RESPONSES, "heart_rate_response")
        if "baroreflex" not in raw and not any(name in values for name in others):
            message = "left out, so nothing is regulated; 1 is the published reflex"
            remarks.warning(f"{key}.baroreflex", message)
        if "venous_set_point_mmHg" in values and values.get("model", "ursino1998") == "ursino1998":
            message = (
                'without effect: ursino1998 does not read right atrial pressure, model = "heldt2004" does'
            )
            remarks.warning(f"{key}.venous_set_point_mmHg", message, shown(values["venous_set_point_mmHg"]))
        read_by = {
            regulation.PAO2_SET_POINT: ("chemoreflex",),
            regulation.PACO2_SET_POINT: ("chemoreflex", "hypoxic_vasodilation", "carbon_dioxide_response"),
            regulation.paco2_set_point("lower"): ("hypoxic_vasodilation", "carbon_dioxide_response"),
            regulation.LUNG_AT_REST: ("hypoxic_vasoconstriction",),
        }
        for name in (
            *regulation.CHEMOREFLEX_SET_POINTS,
            *regulation.DILATION_SET_POINTS,
            regulation.LUNG_AT_REST,
        ):
            readers, key_name = read_by.get(name, ("hypoxic_vasodilation",)), name.partition(".")[2]
            if key_name in values and not any(reader in values for reader in readers):
                message = f"without effect: it is read by {' and '.join(readers)}"
                remarks.warning(f"{key}.{key_name}", message, shown(values[key_name]))

    @classmethod
    def check(cls, sections: Mapping[str, Raw], remarks: Remarks) -> None:
        """Warn of responses to gases if no gases are computed, and of a heart rate that nothing changes."""
        stated = sections.get(cls.section, {})
        acting = {"baroreflex", "chemoreflex"} & stated.keys() or regulation.DRUGS in sections
        if "heart_rate_response" in stated and not acting:
            message = "without effect: neither reflexes nor drugs change the heart rate"
            given = shown(stated["heart_rate_response"])
            remarks.warning(f"{cls.section}.heart_rate_response", message, given)
        for name in GAS_RESPONSES:
            stated = sections.get(cls.section, {}).get(name)
            if stated is not None and "gas" not in sections:
                message = "without effect: blood gases are not computed; add a section [gas]"
                remarks.warning(f"{cls.section}.{name}", message, shown(stated))


def _dose(drug: str) -> Field:
    return replace(setting(PARAMETERS[regulation.dose(drug)]), typical=DRUG_DOSES[drug].usual / 3.0)


class Drugs(_Settings):
    """Steady infusions (ug/kg/min; vasopressin U/min), each multiplied by the patient's sensitivity to it."""

    section = regulation.DRUGS
    noradrenaline: Annotated[float, _dose("noradrenaline")] = 0.0
    adrenaline: Annotated[float, _dose("adrenaline")] = 0.0
    vasopressin: Annotated[float, _dose("vasopressin")] = 0.0
    dobutamine: Annotated[float, _dose("dobutamine")] = 0.0
    milrinone: Annotated[float, _dose("milrinone")] = 0.0
    levosimendan: Annotated[float, _dose("levosimendan")] = 0.0
    nitroprusside: Annotated[float, _dose("nitroprusside")] = 0.0
    noradrenaline_sensitivity: float = 1.0
    adrenaline_sensitivity: float = 1.0
    vasopressin_sensitivity: float = 1.0
    dobutamine_sensitivity: float = 1.0
    milrinone_sensitivity: float = 1.0
    levosimendan_sensitivity: float = 1.0
    nitroprusside_sensitivity: float = 1.0

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Warn of effective doses above the usual range, whose effect is extrapolated."""
        for drug, (_, usual, unit) in DRUG_DOSES.items():
            given, sensitivity = values.get(drug), values.get(f"{drug}_sensitivity", 1.0)
            if not (isinstance(given, float) and isinstance(sensitivity, float)):
                continue
            if given * sensitivity > usual:
                felt = "" if sensitivity == 1.0 else f"equivalent to {given * sensitivity:.3g}, "
                message = f"{felt}beyond the usual {usual:g} {unit}: its effect is extrapolated"
                remarks.warning(f"{key}.{drug}", message, shown(given))
