"""Parameters of the patient beyond the published model: regions, shunts, valves, veins, pericardium.

Origin of the values (measured, fitted or assumed):

- Shares of vessels: distribution of the totals of Table S-1 of Thiel et al. (2025) over regions, from the
  volumes at zero pressure of Heldt (2004), those of an average man: a literature synthesis. Compliances are
  divided as the volumes are (vessels of one wall); Heldt's own compliances would put 16 % into the descending
  aorta, and 9 % of the veins' into the superior cava, and change the published patient by up to 9 %.
- Upper body's share of flow: measured, the superior vena cava's share of systemic flow by Doppler; 35 % from
  the age of six on (Salim et al. 1995).
- Collapsible veins: the thoracic vena cava of Lu et al. (2001), a literature synthesis. Its part of the
  published veins follows from Lu's numbers and the published ones: at 4 mmHg it holds 154 mL, has a
  compliance of 6.67 mL/mmHg and a resistance of 0.005 mmHg s/mL. The law of the empty right heart is assumed.
- Pericardium: Smith et al. (2004); that its volume includes the atria is assumed.
- Bronchial return, areas of valves: the patient's own; the values here are only starting values of a search.

The keys that begin with `physiology.` are set in the section [physiology] of a case file, the others in
[parameters].
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters.parameter import Parameter

SECTION = "physiology"
VALVES = MappingProxyType({"tricuspid": "ra", "pulmonary": "rv", "mitral": "la", "aortic": "lv"})
"""Valves, and the chamber that each drains."""
UPPER_SHARE, BRONCHIAL = f"{SECTION}.upper_share", f"{SECTION}.bronchial_fraction"

_HELDT = "Heldt 2004 (doctoral thesis, MIT), parameters of the circulation"
_SALIM = "Salim et al. 1995, doi 10.1161/01.CIR.92.7.1943: superior caval flow of children over 6 years"

# key, value, unit, description, source, minimum, maximum
_SETTINGS = (
    ("upper_share", 0.35, "1", "Upper body's share of systemic flow at equal pressures", _SALIM, 0.1, 0.6),
    ("bronchial_fraction", 0.015, "1", "Share of systemic conductance that drains into pulmonary veins",
     "1 to 2 % of cardiac output in health (textbooks of physiology)", 0.0, 0.3),
)  # fmt: skip

# kind, start value [cm2], description, minimum, maximum
_AREAS = (
    ("regurgitation", 0.3, "Effective regurgitant orifice area of the {} valve", 0.0, 5.0),
    ("stenosis", 1.0, "Effective orifice area of the open {} valve", 0.1, 15.0),
)

# key, value, description, how it follows from Heldt's table
_SHARES = (
    ("arch_vessel_share", 5.0 / 751.0, "Aortic arch: share of compliance and blood of arteries (sart)",
     "brachiocephalic arteries 5 of 751 mL"),
    ("descending_vessel_share", 26.0 / 751.0, "Descending aorta: likewise",
     "thoracic and abdominal aorta 26 of 751 mL"),
    ("upper_vessel_share", 200.0 / 751.0, "Arteries of the upper body: likewise; the rest is below",
     "200 of 751 mL"),
    ("svc_vessel_share", 661.0 / 2665.0, "Superior cava: share of compliance and blood of veins (svn)",
     "upper body veins and superior vena cava 661 of 2665 mL"),
    ("ascending_drop_share", 0.72, "Share of Rao and Lao before the arch branches",
     "inertance 0.00050 of 0.00050 + 0.65 x 0.00030 mmHg s2/mL"),
    ("descending_drop_share", 0.52, "Share of the rest that lies between arch and descending aorta",
     "resistance 0.011 of 0.021 mmHg s/mL"),
)  # fmt: skip

_LU = "Lu et al. 2001, doi 10.1152/ajpheart.2001.281.6.H2661"
_SMITH = "Smith et al. 2004, doi 10.1016/j.medengphy.2003.10.001"
CAVAL_SHARE, CAVAL_BLOOD = "caval_compliance_share", "caval_blood_share"

# key, value, unit, description, source, minimum, maximum
_VEINS = (
    (CAVAL_SHARE, 1.0 / (0.15 * 20.5), "1", "Thoracic vena cava: share of the veins' compliance (svn)",
     f"{_LU}: 1/0.15 mL/mmHg, of 20.5", 0.05, 0.9),
    (CAVAL_BLOOD, 154.1 / 2880.0, "1", "Thoracic vena cava: share of the veins' blood",
     f"{_LU}: 154 mL at 4 mmHg, of 64 % of 4500 mL", 0.005, 0.5),
    ("caval_rest_volume_ml", 130.0, "mL", "Volume below which the thoracic vena cava buckles", _LU,
     30.0, 400.0),
    ("caval_collapse_mmHg", -5.0, "mmHg", "Pressure at which the thoracic vena cava empties",
     f"{_LU}, as in Albanese et al. 2016, doi 10.1152/ajpheart.00230.2014", -15.0, 0.0),
    ("caval_resistance_share", 0.5, "1", "Thoracic vena cava: share of Rsvn, at 4 mmHg",
     f"{_LU}: 0.001 (350/154)^2 of 0.01 mmHg s/mL", 0.01, 1.0),
    ("chamber_emptying_ml", 2.0, "mL", "Volume over which right atrium and ventricle empty",
     f"assumed; form: {_LU}", 0.5, 10.0),
)  # fmt: skip
_PERICARDIUM = (
    ("pericardium_mmHg", 0.5003, "mmHg", "Pericardium: scale of its pressure", _SMITH, 0.0, 5.0),
    ("pericardium_ml", 250.0, "mL", "Pericardium: volume of the four chambers without pressure",
     f"{_SMITH}: 200 mL of both ventricles; assumed: 50 mL of the atria; grows with a dilated heart",
     50.0, 2000.0),
    ("pericardium_scale_ml", 100.0 / 3.0, "mL", "Pericardium: volume scale of its pressure",
     f"{_SMITH}: 1/0.03", 5.0, 300.0),
)  # fmt: skip
NEEDS = MappingProxyType(
    dict.fromkeys((row[0] for row in _SHARES), "regional")
    | dict.fromkeys((row[0] for row in _VEINS), "collapsible_veins")
    | dict.fromkeys((row[0] for row in _PERICARDIUM), "pericardium")
)
"""Parameters outside the section, and the key of the section that they require."""


def _all_parameters() -> dict[str, Parameter]:
    result = [Parameter(f"{SECTION}.{row[0]}", *row[1:], SECTION) for row in _SETTINGS]
    for valve in VALVES:
        for name, start, meaning, lowest, highest in _AREAS:
            key, text = f"{SECTION}.{valve}_{name}_cm2", meaning.format(valve)
            result.append(Parameter(key, start, "cm2", text, "the patient's own", lowest, highest, SECTION))
    for key, value, meaning, derivation in _SHARES:
        result.append(Parameter(key, value, "1", meaning, f"{_HELDT}: {derivation}", 0.001, 0.95, SECTION))
    result += [Parameter(*row, SECTION) for row in (*_VEINS, *_PERICARDIUM)]
    return {parameter.key: parameter for parameter in result}


PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(_all_parameters())
"""All parameters by key; each has an effect only if [physiology] enables it."""
