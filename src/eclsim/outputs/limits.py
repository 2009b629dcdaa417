"""Limits of patient and circuit, each with its source: one table for command line, figures and bedside page.

A limit belongs to an output of `eclsim.outputs.registry`. None of them judges a patient: they say which
simulated numbers a clinician would be called for, or could not have at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from eclsim.devices.crrt import ALARMS_MMHG

Kind = Literal["collapse", "alarm", "warning"]
GRAVEST_FIRST: tuple[Kind, ...] = ("collapse", "alarm", "warning")
"""Kinds of limits. Beyond a "collapse" the numbers cannot be those of a patient."""

SANSOM_ACCESS_MMHG = 190.0
"""Access pressure above which early circuit failure is more likely (Sansom 2023, cited by Thiel et al.)."""
SUCTION_MMHG = -100.0
"""Drainage pressure below which suction of the vessel wall and haemolysis are feared."""
COLLAPSE_MMHG = -300.0
"""Pressure that no vein withstands: the vessel has collapsed and the computed flow is not to be had."""
CLOSED_L_MIN = 0.02
"""Mean flow below which a valve counts as closed all beat."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound that an output should not cross.

    Attributes:
        quantity: Name of the output.
        kind: "warning", "alarm" or "collapse" (beyond it the numbers are impossible).
        side: Whether the limit is broken by a value "below" or "above" it.
        value: The bound, in the output's unit.
        meaning: What it means to be beyond it.
        source: Where the bound comes from.
        unless: An output in whose presence the limit says nothing.
    """

    quantity: str
    kind: Kind
    side: Literal["below", "above"]
    value: float
    meaning: str
    source: str
    unless: str = ""

    def broken_by(self, value: float) -> bool:
        """Whether a value is beyond the limit (NaN is not)."""
        return value < self.value if self.side == "below" else value > self.value


_SSC = "target in shock, Surviving Sepsis Campaign 2021"
_WALSH = "Walsh et al. 2013: kidney and heart injury after minutes"
_ESC = "ESC/ESH 2018"
_FORRESTER = "Forrester et al. 1976"
_ELSO = "ELSO General Guidelines 2017"
_CARDIOHELP = "warning limit of the Cardiohelp system"
_OWN = "a convention of this project"
_HIGH_VENOUS = "congestion of liver and kidneys"
_CONGESTION = "congestion of the lungs"

_PATIENT = (
    Limit("MAP", "alarm", "below", 55.0, "organs are not perfused", _WALSH),
    Limit("MAP", "warning", "below", 65.0, "organs may not be perfused enough", _SSC),
    Limit("MAP", "warning", "above", 107.0, "hypertension (140/90 mmHg)", _ESC),
    Limit("MAP", "alarm", "above", 133.0, "severe hypertension (180/110 mmHg)", _ESC),
    Limit(
        "pulse_pressure", "warning", "below", 10.0, "the left ventricle hardly ejects",
        "usual minimum on V-A ECMO", unless="lvad_flow",
    ),
    Limit("right_atrial_pressure", "warning", "above", 12.0, _HIGH_VENOUS, "usual target 8 to 12 mmHg"),
    Limit("right_atrial_pressure", "alarm", "above", 20.0, _HIGH_VENOUS, _OWN),
    Limit("venous_pressure", "warning", "above", 12.0, _HIGH_VENOUS, "usual target 8 to 12 mmHg"),
    Limit("venous_pressure", "alarm", "above", 20.0, _HIGH_VENOUS, _OWN),
    Limit("MPAP", "warning", "above", 20.0, "pulmonary hypertension", "ESC/ERS 2022"),
    Limit("MPAP", "alarm", "above", 40.0, "severe pulmonary hypertension", _OWN),
    *(
        limit
        for name in ("PCWP", "left_atrial_pressure")
        for limit in (
            Limit(name, "warning", "above", 18.0, _CONGESTION, _FORRESTER),
            Limit(name, "alarm", "above", 25.0, "oedema of the lungs", "McHugh et al. 1972"),
        )
    ),
    Limit(
        "end_diastolic_pressure_lv", "warning", "above", 16.0, "raised filling of the left ventricle",
        "ESC 2016",
    ),
)  # fmt: skip

_NO_CHAMBER = "no chamber ejects so; its volume is negative"
_IMPOSSIBLE = tuple(
    limit
    for name in ("ejection_fraction_lv", "ejection_fraction_rv")
    for limit in (
        Limit(name, "collapse", "below", 0.0, _NO_CHAMBER, "arithmetic"),
        Limit(name, "collapse", "above", 100.0, _NO_CHAMBER, "arithmetic"),
    )
) + tuple(
    Limit(
        name, "alarm", "below", 0.0, "the great veins collapse, and flow that drains them is not to be had",
        "pressure of the surroundings",
    )
    for name in ("right_atrial_pressure", "venous_pressure")
)  # fmt: skip

_HIGH = "danger of rupture and haemolysis"
_ECMO = (
    Limit("PF", "alarm", "below", 0.0, "blood runs backwards through the ECMO circuit: clamp it", "physics"),
    Limit(
        "lvad_flow", "alarm", "below", 0.0,
        "blood runs back through the LVAD into the heart: raise its speed", "physics",
    ),
    Limit(
        "lowest_drainage_pressure", "warning", "below", SUCTION_MMHG, "suction: lower the pump speed",
        _CARDIOHELP,
    ),
    Limit(
        "lowest_drainage_pressure", "collapse", "below", COLLAPSE_MMHG,
        "the vessel collapses and this flow is not to be had: lower the pump speed", _ELSO,
    ),
    Limit(
        "pump_inlet_pressure", "alarm", "below", COLLAPSE_MMHG,
        "cavitation and haemolysis: lower the pump speed", _ELSO,
    ),
    *(
        limit
        for name in (
            "post_pump_pressure", "pre_oxygenator_pressure", "post_oxygenator_pressure",
            "return_cannula_pressure",
        )
        for limit in (
            Limit(name, "warning", "above", 300.0, _HIGH, "usual upper limit of ECMO circuits"),
            Limit(name, "alarm", "above", 400.0, _HIGH, _ELSO),
        )
    ),
)  # fmt: skip

_MACHINE = "usual alarm of CRRT machines"
_CRRT = (
    *(
        limit
        for line, (low, high) in ALARMS_MMHG.items()
        for limit in (
            Limit(f"crrt_{line}_pressure", "alarm", "below", low, "machine alarm", _MACHINE),
            Limit(f"crrt_{line}_pressure", "alarm", "above", high, "machine alarm", _MACHINE),
        )
    ),
    Limit(
        "crrt_access_pressure", "warning", "above", SANSOM_ACCESS_MMHG,
        "early circuit failure is more likely", "Sansom et al. 2023",
    ),
)  # fmt: skip

_SAME = (
    ("right_atrial_pressure", "venous_pressure"),
    ("PCWP", "left_atrial_pressure", "end_diastolic_pressure_lv"),
    (
        "post_pump_pressure", "pre_oxygenator_pressure", "post_oxygenator_pressure",
        "return_cannula_pressure",
    ),
    ("lowest_drainage_pressure", "pump_inlet_pressure"),
)  # fmt: skip
"""Outputs that say the same about a patient: the gravest limit of them is told, not each."""

LIMITS: tuple[Limit, ...] = (*_IMPOSSIBLE, *_PATIENT, *_ECMO, *_CRRT)
"""All limits."""

PLACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "ao": ("MAP", "pulse_pressure"),
        "sart": ("MAP",),
        "svn": ("venous_pressure",),
        "ra": ("right_atrial_pressure",),
        "pas": ("MPAP",),
        "part": ("MPAP",),
        "pvn": ("PCWP",),
        "la": ("left_atrial_pressure",),
        "lv": ("end_diastolic_pressure_lv", "ejection_fraction_lv"),
        "rv": ("ejection_fraction_rv",),
        "ecmodrain": ("lowest_drainage_pressure",),
        "ecmotudp": ("pump_inlet_pressure",),
        "ecmotupo": ("post_pump_pressure",),
        "ecmooxy": ("pre_oxygenator_pressure",),
        "ecmotuor": ("post_oxygenator_pressure",),
        "ecmoreturn": ("return_cannula_pressure",),
        "crrttuin": ("crrt_access_pressure",),
        "crrttuout": ("crrt_return_pressure",),
    }
)
"""Outputs whose limits are those of a compartment, for pictures of the circuit."""


def limits_of(quantity: str, outputs: Collection[str] = ()) -> tuple[Limit, ...]:
    """The limits of an output, the gravest first.

    Args:
        quantity: name of the output.
        outputs: names of all outputs that the circuit has; some limits hold without an LVAD only.
    """
    own = (limit for limit in LIMITS if limit.quantity == quantity and limit.unless not in outputs)
    return tuple(sorted(own, key=lambda limit: GRAVEST_FIRST.index(limit.kind)))


def level(quantity: str, value: float, outputs: Collection[str] = ()) -> str:
    """How a value stands to the limits of its output: "ok", "warning", "alarm" or "collapse".

    Args:
        quantity: name of the output.
        value: in the output's unit.
        outputs: names of all outputs that the circuit has.
    """
    return next((limit.kind for limit in limits_of(quantity, outputs) if limit.broken_by(value)), "ok")


def worst(levels: Iterable[str]) -> str:
    """The gravest of some levels; "ok" if there is none."""
    found = set(levels)
    return next((kind for kind in GRAVEST_FIRST if kind in found), "ok")


def place_level(place: str, outputs: Mapping[str, float]) -> str:
    """The gravest level of the outputs that stand for a compartment.

    Args:
        place: name of the compartment.
        outputs: values by name.
    """
    names = [name for name in PLACES.get(place, ()) if name in outputs]
    return worst(level(name, outputs[name], outputs) for name in names)


def broken_limits(outputs: Mapping[str, float]) -> list[Limit]:
    """The limits that a beat breaks, the gravest first: of what says the same, one limit.

    Args:
        outputs: values by name.
    """
    found: dict[tuple[str, str], Limit] = {}
    for kind in GRAVEST_FIRST:
        for limit in LIMITS:
            value = outputs.get(limit.quantity)
            if value is None or limit.kind != kind or limit.unless in outputs:
                continue
            if limit.broken_by(value):
                found.setdefault((_told_as(limit.quantity), limit.side), limit)
    return list(found.values())


def _told_as(quantity: str) -> str:
    return next((names[0] for names in _SAME if quantity in names), quantity)
