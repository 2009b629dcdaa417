"""Parts of an ECMO circuit with their sources: pumps, oxygenators, tubing, membrane, clamps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from eclsim.devices.device import Naming
from eclsim.devices.products import UNVALIDATED, Membrane, Oxygenator, PumpCurve, by_key
from eclsim.inputs.fields import number
from eclsim.parameters.parameter import Bounds, Parameter
from eclsim.parameters.thiel2025 import circuit_parameters

GROUP = "ecmo"
LINES = ("drainage", "return")
GAS_KEYS = ("sweep_l_min", "fdo2", "drainage_mixing")
"""Keys of the section that only gas exchange uses."""

PUMPS = by_key(
    (
        PumpCurve(
            key="Rotaflow", name="Rotaflow RF-32", use="ECMO", a=1.9583e-5, R1=-0.007545, R2=2.8864,
            Rrec=4.0256, kinf=0.0016, speed_range_rpm=(1000, 5000),
            evidence="one bench point in bovine blood, 3000 rpm and 4.2 L/min: 222 mmHg against 250 ± 10",
        ),
        PumpCurve(
            key="DP3", name="DP3", use="ECMO", a=6.5298e-6, R1=-1.9593e-3, R2=4.0802, Rrec=5.0355,
            kinf=0.0004, speed_range_rpm=(4000, 8000), evidence=UNVALIDATED,
        ),
    )
)  # fmt: skip
"""Rotary pumps by key (the name in case files)."""
ROLLER = number("Flow of a roller pump", "L/min", 0, 10, 4)
"""Key of a roller pump's table, `pump = { roller_l_min = 4.0 }`."""

_LABEL = "unvalidated pressure drop; label flow from FDA clearance K150267"
_LARGE_MEMBRANE, _SMALL_MEMBRANE = Membrane(7.0, 0.09, 4.66), Membrane(5.0, 0.0853, 3.37)
"""Membranes of 1.8 and 1.3 m2 after Khadka et al. 2024. Oxygen: 76 and 450 mL/min and a PO2 behind it of 376
and 120 mmHg at 1 and 7 L/min, and 5/7 of it at 5 L/min (0.09 (5/7)^0.16). Carbon dioxide, scaled by area: the
amounts removed at 1 and 7 L/min from blood that must have had 61.5 mmHg, as a gas flow of 1:1 carries 59
mL/min from 45 mmHg and 64 were measured. With a rating of 95 % saturation behind them they would transfer 346
mL/min of oxygen."""
OXYGENATORS = by_key(
    (
        Oxygenator(
            key="Quadrox-i Adult", resistance=0.6744, priming_volume_ml=335.0, label_flow_l_min=(0.5, 7.0),
            evidence=_LABEL, membrane=_LARGE_MEMBRANE,
        ),
        Oxygenator(
            key="Quadrox-i Small Adult", resistance=0.5174, priming_volume_ml=295.0,
            label_flow_l_min=(0.5, 5.0), evidence=_LABEL, membrane=_SMALL_MEMBRANE,
        ),
        Oxygenator(
            key="Nautilus MC3", resistance=0.6312, priming_volume_ml=None, label_flow_l_min=None,
            evidence=UNVALIDATED, membrane=_LARGE_MEMBRANE,
        ),
    )
)  # fmt: skip
"""Oxygenators by key (the name in case files)."""
ASSUMED_ML = OXYGENATORS["Quadrox-i Adult"].priming_volume_ml or math.nan
"""Blood volume assumed for an oxygenator without a published one [mL]."""

_R, _C = "mmHg s/mL", "mL/mmHg"
TUBING = circuit_parameters(
    GROUP, "S-2",
    (
        ("Decmotudp", 0.9625, "cm", "Diameter of tubing drainage - pump (3/8 inch)", 0.2, 2.5, "installed"),
        ("Lecmotudp", 200.0, "cm", "Length of tubing drainage - pump", 1.0, 1000.0, "installed"),
        ("Decmotupo", 0.9625, "cm", "Diameter of tubing pump - oxygenator (3/8 inch)", 0.2, 2.5, "installed"),
        ("Lecmotupo", 20.0, "cm", "Length of tubing pump - oxygenator", 1.0, 1000.0, "installed"),
        (
            "Decmotuor", 0.9625, "cm", "Diameter of tubing oxygenator - return (3/8 inch)", 0.2, 2.5,
            "installed",
        ),
        ("Lecmotuor", 200.0, "cm", "Length of tubing oxygenator - return", 1.0, 1000.0, "installed"),
        ("Recmooxy", 0.6744, _R, "Resistance of oxygenator", 0.01, 5.0, "data sheet, taken as linear"),
        ("Cecmodrain", 0.1, _C, "Compliance of drainage cannula", 1e-4, 5.0, "assumed"),
        ("Cecmotudp", 0.1, _C, "Compliance of tubing drainage - pump", 1e-4, 5.0, "assumed"),
        ("Cecmotupo", 0.1, _C, "Compliance of tubing pump - oxygenator", 1e-4, 5.0, "assumed"),
        ("Cecmooxy", 0.008, _C, "Compliance of oxygenator", 1e-4, 5.0, "assumed"),
        ("Cecmotuor", 0.1, _C, "Compliance of tubing oxygenator - return", 1e-4, 5.0, "assumed"),
        ("Cecmoreturn", 0.1, _C, "Compliance of return cannula", 1e-4, 5.0, "assumed"),
    ),
)  # fmt: skip
_VASLEF = "form of Vaslef et al. 1994 (ASAIO J 40:990); default for 1.8 m2"
_FITTED = "fitted to Khadka et al. 2024 (doi 10.5772/intechopen.1006540)"
GAS_PARAMETERS = (
    Parameter(
        "ecmo.sweep_l_min", 4.0, "L/min", "Sweep gas of the oxygenator; 0: it exchanges nothing",
        "setting", 0.0, 20.0, GROUP, clipped=True,
    ),
    Parameter(
        "ecmo.fdo2", 1.0, "1", "Fraction of oxygen in the sweep gas", "setting", 0.21, 1.0, GROUP,
        half_width=0.25, clipped=True,
    ),
    Parameter(
        "ecmo.drainage_mixing", 1.0, "1",
        "Where drainage and return share a compartment: 1, its blood is drained; 0, that of its veins",
        "assumed; recirculation is m Qe / (CO + m Qe): medians of 9, 18 and 28 % mean 0.14, 0.32, 0.58",
        0.0, 1.0, GROUP, Bounds(0.5, 0.0, 1.0), 0.25, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.oxygen_transfer", 0.09, "mL/min/mmHg",
        "Oxygen transfer of the oxygenator's membrane at 1 L/min", f"{_VASLEF}; {_FITTED}",
        0.001, 1.0, GROUP, Bounds(0.09, 0.009, 0.9), clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.oxygen_exponent", 0.84, "1", "Exponent of blood flow in the oxygen transfer",
        f"{_VASLEF}; {_FITTED}", 0.3, 1.0, GROUP, half_width=0.1, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.carbon_dioxide_transfer", 4.66, "mL/min/mmHg",
        "Carbon dioxide transfer of the oxygenator's membrane at 1 L/min",
        "64 and 648 mL/min at 1 and 7 L/min, 1 and 35 L/min of gas (Khadka et al. 2024), by membrane area",
        0.1, 50.0, GROUP, clipped=True,
    ),
    Parameter(
        "ecmo.oxygenator.clotted_fraction", 0.0, "1", "Share of the oxygenator's membrane that is clotted",
        "0 when new", 0.0, 0.99, GROUP, Bounds(0.2, 0.0, 0.99), 0.25, clipped=True,
    ),
)  # fmt: skip
"""Sweep gas, recirculation, membrane; the first three are keys of the section. Bounds are wide on purpose."""
GAS_IF_OMITTED = {
    name: one.value for one in GAS_PARAMETERS if (name := one.key.removeprefix(f"{GROUP}.")) in GAS_KEYS
}
"""Values of the keys of gas exchange that a section leaves out."""
MEMBRANE = (
    "ecmo.oxygenator.oxygen_transfer", "ecmo.oxygenator.oxygen_exponent",
    "ecmo.oxygenator.carbon_dioxide_transfer", "ecmo.oxygenator.clotted_fraction",
    "ecmo.sweep_l_min", "ecmo.fdo2",
)  # fmt: skip
"""Parameters of the membrane, in the order of `eclsim.components.MembraneLung`."""

SMALLEST_EXHAUST = 1.0
"""Flow of exhaust gas of an oxygenator [mL/min STPD] below which its partial pressures are not computed."""

RETURN_CLAMP = "return_clamp"
DRAINAGE_CLAMP = "drainage_clamp"
CLAMPS = (RETURN_CLAMP, DRAINAGE_CLAMP)
"""Keys of the clamps on the return line and on the drainage line."""


def is_clamped(names: Naming, values: Mapping[str, float]) -> bool:
    """Whether the return line of a circuit is at least partly clamped."""
    return values.get(names.parameter(f"ecmo.{RETURN_CLAMP}"), 0.0) > 0.0


def narrowest_line_of(settings: Mapping[str, Any], vented: bool) -> tuple[str, float]:
    """The line of a circuit, "drainage" or "return", that is closed most, and its closed share.

    Of two cannulae of a line, the wider one counts; a second drainage cannula and a vent have no clamp.

    Args:
        settings: clamps and sizes of second cannulae, by the keys of the section.
        vented: whether a vent drains into the circuit.
    """
    drainage, back = (settings.get(clamp) or 0.0 for clamp in (DRAINAGE_CLAMP, RETURN_CLAMP))
    if vented or settings.get("second_drainage_fr") is not None:
        drainage = 0.0
    if settings.get("second_return_fr") is not None:
        back = min(back, settings.get("second_return_clamp") or 0.0)
    return ("return", back) if back >= drainage else ("drainage", drainage)


def narrowest_line(names: Naming, values: Mapping[str, float]) -> tuple[str, float]:
    """As `narrowest_line_of`, from the parameters of a circuit."""
    keys = (*CLAMPS, "second_drainage_fr", "second_return_fr", "second_return_clamp")
    settings = {key: values.get(names.parameter(f"{GROUP}.{key}")) for key in keys}
    return narrowest_line_of(settings, not names.name and "vent.fr" in values)


def is_closed(names: Naming, values: Mapping[str, float]) -> bool:
    """Whether drainage or return of a circuit is clamped off, so that its blood stands still."""
    return narrowest_line(names, values)[1] >= 1.0
