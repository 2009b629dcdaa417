"""The section [gas]: the patient's blood, metabolism, lungs and ventilator."""

from __future__ import annotations

from typing import Any

from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters.gas import PARAMETERS, PREFIX

GRAMS_PER_MMOL = 1.6114
"""Haemoglobin [g/dL] of 1 mmol/L of its monomer."""
LOW_HAEMOGLOBIN = 7.0
"""Haemoglobin [g/dL] below which the number may be in mmol/L."""


class Gas(Section):
    """Oxygen and carbon dioxide of the patient; what is left out has the default of its table.

    Haemoglobin in g/dL, base excess in mmol/L, temperature in C, oxygen consumption in mL/min (STPD; left
    out, from the body surface), ventilation in L/min (BTPS); the others are fractions.
    """

    section = "gas"
    parameters = PARAMETERS
    haemoglobin_g_dl: float = 10.0
    base_excess_mmol_l: float = 0.0
    temperature_c: float = 37.0
    vo2_ml_min: float | None = None
    respiratory_quotient: float = 0.8
    fio2: float = 0.5
    alveolar_ventilation_l_min: float = 2.0
    shunt_fraction: float = 0.4

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Say which defaults are used, and doubt a haemoglobin that may be in mmol/L."""
        left_out = [name for name in cls.fields() if name not in raw and name != "vo2_ml_min"]
        if left_out:
            used = (f"{name} = {PARAMETERS[PREFIX + name].value:g}" for name in left_out)
            remarks.note(key, f"left out, so assumed: {', '.join(used)}")
        if "vo2_ml_min" not in raw:
            remarks.note(f"{key}.vo2_ml_min", "left out, so 126 mL/min per m2 of body surface (Dehmer 1982)")
        haemoglobin = values.get("haemoglobin_g_dl")
        if haemoglobin is not None and haemoglobin < LOW_HAEMOGLOBIN:
            meant = f"{haemoglobin:g} mmol/L = {haemoglobin * GRAMS_PER_MMOL:.1f} g/dL"
            message = f"below {LOW_HAEMOGLOBIN:g} g/dL, the usual threshold of transfusion; used as g/dL"
            remarks.warning(f"{key}.haemoglobin_g_dl", message, shown(haemoglobin), meant)
