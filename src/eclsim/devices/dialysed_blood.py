"""What dialyzers of all devices share: their flows of fluid, and the blood that reaches them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from eclsim.devices.description import GASES, BeatMeasures, Numbers
from eclsim.inputs.fields import Field, number

if TYPE_CHECKING:
    from eclsim.components.dialysis import Performance
    from eclsim.inputs.sections import Section

RED_CELL_HAEMOGLOBIN = 33.3
"""Haemoglobin in a dL of red cells [g], the usual mean corpuscular concentration."""
THE_BLOODS_OWN = 0.0
"""Carbon dioxide of the plasma that says: that of the blood which enters, from its gases."""
TEMPERATURE = "gas.temperature_c"
UNKNOWN_GASES = (0.0, 7.4, 37.0)
"""PCO2, pH and temperature where gases are not followed; the plasma's carbon dioxide is set then."""


def fluid_flow(
    description: str, typical: float, least: float = 20.0, maximum: float = 20000.0, required: bool = False
) -> Field:
    """A flow of fluid [mL/h]; no machine gives less than the least, which is likely in L/h."""
    one = number(description, "mL/h", 0, maximum, typical, required=required)
    return replace(one, least=least)


def dialysed_blood(section: Section, haemoglobin_g_dl: float, gases: bool) -> dict[str, float]:
    """What a section with `haematocrit_in` and `plasma_bicarbonate_mmol_l` leaves to the patient's blood."""
    own = {"haematocrit_in": haemoglobin_g_dl / RED_CELL_HAEMOGLOBIN}
    if gases:
        own["plasma_bicarbonate_mmol_l"] = THE_BLOODS_OWN
    return {f"{section.section}.{key}": own[key] for key in own if getattr(section, key) is None}


def filtered(
    m: BeatMeasures, blood: Sequence[Numbers], settings: Sequence[str], entering: str | None
) -> Performance:
    """What a filter does in a beat (`eclsim.components.dialysis.Performance`).

    Args:
        m: measures of the beat.
        blood: its flow [mL/min], and its pressure before and behind the fibres [mmHg].
        settings: parameters of the filter.
        entering: connection whose blood is asked for its gases where they are followed.
    """
    from eclsim.components import dialysis

    gases: Sequence[Numbers] = UNKNOWN_GASES
    if entering is not None and GASES in m.circuit.content_names():
        gases = [m.gas("PCO2", "into", entering), m.gas("pH", "into", entering), m.parameter(TEMPERATURE)]
    numbers = [*blood, *gases, *map(m.parameter, settings)]
    return dialysis.Performance(*m.apply(dialysis.performance, numbers))
