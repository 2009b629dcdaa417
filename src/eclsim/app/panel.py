"""The panel of knobs and the shape of the circuit as plain data for the browser."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eclsim.app.knobs import OTHER_MODE, Knob, Picker
from eclsim.app.texts import text
from eclsim.parameters import default

if TYPE_CHECKING:
    from eclsim.cases.case import Case

_SIZES = {"speed_rpm", "drainage_fr", "return_fr", "oxygenator"}


def shape_of(case: Case) -> tuple[Any, ...]:
    """What the drawing depends on; while it is the same only numbers change."""
    ecmo = case.ecmo and case.ecmo.model_dump_json(exclude=_SIZES)
    lines = case.crrt and (case.crrt.access_site, case.crrt.return_site)
    return ecmo, lines, case.lvad and (case.lvad.inlet_site, case.lvad.outlet_site)


def described(control: Knob | Picker) -> dict[str, Any]:
    """A knob or picker as plain data."""
    section, _, name = control.key.partition(".")
    hint = f"{name}: {default(name).description}" if section == "parameters" else ""
    common = {"key": control.key, "group": control.group, "label": text(control.key), "hint": hint}
    if isinstance(control, Knob):
        return common | {
            "unit": control.unit, "low": control.low, "high": control.high, "step": control.step,
            "log": control.logarithmic,
        }  # fmt: skip
    return common | {"options": [[name, option_words(name)] for name in control.options]}


def option_words(name: str) -> str:
    """A name of a picker in words."""
    from eclsim.crrt_study.schemes import POSITION_WORDS
    from eclsim.patient.sites import PATIENT_SITES

    if name in ("VA", "VV", OTHER_MODE):
        return text(name)
    return POSITION_WORDS.get(name) or PATIENT_SITES.get(name) or name
