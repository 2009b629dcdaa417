"""Parameters of the Shi and Hose (2009) CellML circulation, after Korakianitis and Shi (2006).

A code-verification case: the published CellML model fixes every number, so two programs can be
compared digit by digit. It is not a healthy adult (its pulmonary artery mean is 40 mmHg). Its
chambers follow P = p0 + E(phase) (V - v0), E = Emin + (Emax - Emin) activation(phase), a different
law from that of Thiel et al. (2025). All values are assumed by its authors. The pulmonary
vein's resistance of 0.006 follows the CellML file; the printed paper is known to differ there.
Units: mmHg, mL, s; valve coefficients in mL/(s mmHg^1/2).
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters.parameter import Parameter

_SOURCE = "Shi and Hose 2009 CellML model, after Korakianitis and Shi 2006; assumed"
_R, _C, _L, _E = "mmHg s/mL", "mL/mmHg", "mmHg s^2/mL", "mmHg/mL"

# chamber: name, v0 [mL], p0 [mmHg], Emin, Emax [mmHg/mL], initial volume [mL]
_CHAMBERS = (
    ("lv", "left ventricle", 5.0, 1.0, 0.1, 2.5, 500.0),
    ("rv", "right ventricle", 10.0, 1.0, 0.1, 1.15, 500.0),
    ("la", "left atrium", 4.0, 1.0, 0.15, 0.25, 20.0),
    ("ra", "right atrium", 4.0, 1.0, 0.15, 0.25, 20.0),
)

# key, value, unit, description, group
_OTHERS = (
    ("heart_rate_bpm", 60.0, "bpm", "Heart rate", "heart"),
    ("ventricle_peak", 0.3, "1", "Share of the beat at which the ventricle's activation peaks", "heart"),
    ("ventricle_end", 0.45, "1", "Share of the beat at which the ventricle's activation ends", "heart"),
    ("atrium_start", 0.92, "1", "Share of the beat at which the atrium's activation starts", "heart"),
    ("atrium_length", 0.09, "1", "Length of the atrium's activation as a share of the beat", "heart"),
    ("CQao", 350.0, "mL/(s mmHg^1/2)", "Flow coefficient of aortic valve", "heart"),
    ("CQmi", 400.0, "mL/(s mmHg^1/2)", "Flow coefficient of mitral valve", "heart"),
    ("CQtri", 400.0, "mL/(s mmHg^1/2)", "Flow coefficient of tricuspid valve", "heart"),
    ("CQpa", 350.0, "mL/(s mmHg^1/2)", "Flow coefficient of pulmonary valve", "heart"),
    ("Csas", 0.08, _C, "Compliance of aortic sinus", "systemic"),
    ("Rsas", 0.003, _R, "Resistance of aortic sinus", "systemic"),
    ("Lsas", 6.2e-5, _L, "Inertance of aortic sinus", "systemic"),
    ("Csat", 1.6, _C, "Compliance of systemic artery", "systemic"),
    ("Rsat", 0.05, _R, "Resistance of systemic artery", "systemic"),
    ("Lsat", 0.0017, _L, "Inertance of systemic artery", "systemic"),
    ("Rsar", 0.5, _R, "Resistance of systemic arterioles", "systemic"),
    ("Rscp", 0.52, _R, "Resistance of systemic capillaries", "systemic"),
    ("Csvn", 20.5, _C, "Compliance of systemic vein", "systemic"),
    ("Rsvn", 0.075, _R, "Resistance of systemic vein", "systemic"),
    ("Cpas", 0.18, _C, "Compliance of pulmonary sinus", "pulmonary"),
    ("Rpas", 0.002, _R, "Resistance of pulmonary sinus", "pulmonary"),
    ("Lpas", 5.2e-5, _L, "Inertance of pulmonary sinus", "pulmonary"),
    ("Cpat", 3.8, _C, "Compliance of pulmonary artery", "pulmonary"),
    ("Rpat", 0.01, _R, "Resistance of pulmonary artery", "pulmonary"),
    ("Lpat", 0.0017, _L, "Inertance of pulmonary artery", "pulmonary"),
    ("Rpar", 0.05, _R, "Resistance of pulmonary arterioles", "pulmonary"),
    ("Rpcp", 0.25, _R, "Resistance of pulmonary capillaries", "pulmonary"),
    ("Cpvn", 20.5, _C, "Compliance of pulmonary vein", "pulmonary"),
    ("Rpvn", 0.006, _R, "Resistance of pulmonary vein", "pulmonary"),
    ("P0sas", 100.0, "mmHg", "Initial pressure of aortic sinus", "initial"),
    ("P0sat", 100.0, "mmHg", "Initial pressure of systemic artery", "initial"),
    ("P0svn", 0.0, "mmHg", "Initial pressure of systemic vein", "initial"),
    ("P0pas", 30.0, "mmHg", "Initial pressure of pulmonary sinus", "initial"),
    ("P0pat", 30.0, "mmHg", "Initial pressure of pulmonary artery", "initial"),
    ("P0pvn", 0.0, "mmHg", "Initial pressure of pulmonary vein", "initial"),
)


def _range(value: float, unit: str) -> tuple[float, float]:
    if unit == "1":
        return 0.0, 1.0
    return (0.0, 1000.0) if unit in ("mmHg", "mL") else (value / 100.0, value * 100.0)


def _all_parameters() -> dict[str, Parameter]:
    rows = list(_OTHERS)
    for place, label, volume, pressure, low, high, initial in _CHAMBERS:
        rows += [
            (f"v0{place}", volume, "mL", f"Volume of {label} at which its elastic pressure is zero", "heart"),
            (f"p0{place}", pressure, "mmHg", f"Pressure offset of {label}", "heart"),
            (f"Emin{place}", low, _E, f"Diastolic elastance of {label}", "heart"),
            (f"Emax{place}", high, _E, f"Systolic elastance of {label}", "heart"),
            (f"V0{place}", initial, "mL", f"Initial volume of {label}", "initial"),
        ]
    return {
        key: Parameter(key, value, unit, label, _SOURCE, *_range(value, unit), group)
        for key, value, unit, label, group in rows
    }


PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(_all_parameters())
"""Every parameter of the set, by key (sas, sat: aortic sinus, systemic artery; pas, pat: pulmonary)."""
