"""Devices that can be connected: blood pumps, cannulae, oxygenators and the dialyzer.

Constants are those published with the code of Thiel et al. (2025): pump curves after the method of
Boes et al. (2019), cannulae, oxygenators and dialyzer from the makers' data sheets. They stay in
the makers' units (rpm, L/min, mmHg). How far each was checked against other data stands in
`evidence`; where that begins with "unvalidated", results rest on the published constants alone.

Cannula charts of makers are mostly measured in water: in blood the flow at the same pressure is 3
to 21 % lower (Broman et al., ECMO cannulae I and II).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

SOURCE = "published code of Thiel et al. 2025 (makers' data sheets; pump equation of Boes et al. 2019)"


@dataclass(frozen=True, slots=True)
class RotaryPump:
    """A rotary blood pump.

    Head [mmHg] at speed n [rpm] and flow Q [L/min]:
    H = a n^2 - R1 n Q - R2 Q^2 + Rrec (Q - kinf n)^2, the last term only for Q < kinf n.

    Attributes:
        key: The name users write.
        name: The maker's name.
        use: "ECMO" or "LVAD".
        a: Head at zero flow per squared speed [mmHg/rpm^2].
        R1: Loss with speed times flow [mmHg/(rpm L/min)].
        R2: Loss with squared flow [mmHg/(L/min)^2].
        Rrec: Recirculation at low flow [mmHg/(L/min)^2].
        kinf: Flow per speed below which recirculation acts [(L/min)/rpm].
        speed_range_rpm: Lowest and highest speed in use.
        evidence: What the curve was compared with.
        L: Inertance of the pump [mmHg s^2/L], LVAD only.
        Rper: Resistance of the outflow graft [mmHg/(L/min)^2], LVAD only.
        Lper: Inertance of the outflow graft [mmHg s^2/L], LVAD only.
    """

    key: str
    name: str
    use: str
    a: float
    R1: float
    R2: float
    Rrec: float
    kinf: float
    speed_range_rpm: tuple[float, float]
    evidence: str
    L: float | None = None
    Rper: float | None = None
    Lper: float | None = None
    source: str = SOURCE

    @property
    def constants(self) -> dict[str, float]:
        """The constants of the pump equation, by name; inertial ones only where the pump has them."""
        names = ("a", "R1", "R2", "Rrec", "kinf", "L", "Rper", "Lper")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def head_mmhg(self, speed_rpm: float, flow_l_min: float) -> float:
        """Pressure head [mmHg] at a speed [rpm] and a flow [L/min]."""
        head = self.a * speed_rpm**2 - self.R1 * speed_rpm * flow_l_min - self.R2 * flow_l_min**2
        below = min(flow_l_min - self.kinf * speed_rpm, 0.0)
        return head + self.Rrec * below**2


@dataclass(frozen=True, slots=True)
class CannulaType:
    """A family of cannulae: flow Q [L/min] = sqrt(dP / R), R a cubic in the French size.

    Attributes:
        key: "arterial" (return) or "venous" (drainage, also used for veno-venous return).
        name: The maker's name.
        coefficients: Of D^3, D^2, D and 1, D in Fr, R in mmHg/(L/min)^2.
        length_cm: Length [cm] of each size that the maker lists [Fr].
        evidence: What the law was compared with.
    """

    key: str
    name: str
    coefficients: tuple[float, float, float, float]
    length_cm: MappingProxyType[int, float]
    evidence: str
    source: str = SOURCE

    @property
    def sizes_fr(self) -> tuple[int, ...]:
        """Sizes that the maker lists [Fr]."""
        return tuple(self.length_cm)

    def resistance(self, size_fr: float) -> float:
        """R [mmHg/(L/min)^2] at a size [Fr]; between listed sizes the cubic interpolates."""
        c3, c2, c1, c0 = self.coefficients
        return ((c3 * size_fr + c2) * size_fr + c1) * size_fr + c0

    def pressure_drop_mmhg(self, size_fr: float, flow_l_min: float) -> float:
        """Pressure drop [mmHg] at a size [Fr] and a flow [L/min]."""
        return self.resistance(size_fr) * flow_l_min * abs(flow_l_min)


@dataclass(frozen=True, slots=True)
class Oxygenator:
    """An oxygenator with a linear pressure drop.

    Attributes:
        key: The maker's name, as users write it.
        resistance: [mmHg s/mL].
        priming_volume_ml: [mL], None where the maker's number is not at hand.
        label_flow_l_min: Lowest and highest flow of the label [L/min], None where not at hand.
        evidence: What the pressure drop was compared with.
    """

    key: str
    resistance: float
    priming_volume_ml: float | None
    label_flow_l_min: tuple[float, float] | None
    evidence: str
    source: str = SOURCE

    def label_warning(self, flow_l_min: float) -> str | None:
        """What to say about a flow [L/min] outside the label, or None inside it or without one."""
        if self.label_flow_l_min is None:
            return None
        low, high = self.label_flow_l_min
        rounded = float(f"{flow_l_min:.3g}")  # as it is shown: a roller pump at the limit is within it
        if low <= rounded <= high:
            return None
        return f"{flow_l_min:.3g} L/min is outside the label of the {self.key}, {low:g} to {high:g} L/min"


@dataclass(frozen=True, slots=True)
class Dialyzer:
    """A CRRT filter: resistance [mmHg s/mL], priming volume [mL] and what they rest on."""

    key: str
    resistance: float
    priming_volume_ml: float
    evidence: str
    source: str = SOURCE


_NOTHING = "unvalidated: no independent data found"
_CANNULA_EVIDENCE = "unvalidated: no data of these cannulae found; others of one size differ by 30 %"
_LABEL = "unvalidated pressure drop; label flow from FDA clearance K150267"
_SPEEDS = "the speed range is the usual clinical one, not part of the published constants"

_PUMPS = (
    RotaryPump(
        "Rotaflow",
        "Rotaflow RF-32",
        "ECMO",
        a=1.9583e-5,
        R1=-0.007545,
        R2=2.8864,
        Rrec=4.0256,
        kinf=0.0016,
        speed_range_rpm=(1000, 5000),
        evidence="one bench point in bovine blood, 3000 rpm and 4.2 L/min: 222 mmHg against 250 ± 10",
    ),
    RotaryPump(
        "DP3",
        "DP3",
        "ECMO",
        a=6.5298e-6,
        R1=-1.9593e-3,
        R2=4.0802,
        Rrec=5.0355,
        kinf=0.0004,
        speed_range_rpm=(4000, 8000),
        evidence=_NOTHING,
    ),
    RotaryPump(
        "HMII",
        "HeartMate II",
        "LVAD",
        a=9.5356e-7,
        R1=-3.2085e-4,
        R2=0.8643,
        Rrec=3.0701,
        kinf=3.5925e-4,
        L=22.9733,
        Rper=0.3833,
        Lper=20.3038,
        speed_range_rpm=(6000, 15000),
        evidence=f"another published fit lies 5 to 14 mmHg away, perhaps with its cannulae; {_SPEEDS}",
    ),
    RotaryPump(
        "HM3",
        "HeartMate 3",
        "LVAD",
        a=3.4578e-6,
        R1=-7.2946e-4,
        R2=2.2453,
        Rrec=3.3580,
        kinf=2.5962e-4,
        L=17.0010,
        Rper=0.1244,
        Lper=13.3873,
        speed_range_rpm=(3000, 9000),
        evidence=f"37 points of the maker's chart, 3000 to 9000 rpm: root mean square 5.4 mmHg; {_SPEEDS}",
    ),
    RotaryPump(
        "HVAD",
        "HVAD",
        "LVAD",
        a=1.3307e-5,
        R1=3.8732e-4,
        R2=0.7667,
        Rrec=4.7622,
        kinf=1.4703e-4,
        L=18.7352,
        Rper=0.1093,
        Lper=14.1544,
        speed_range_rpm=(1800, 4000),
        evidence=f"{_NOTHING}; {_SPEEDS}",
    ),
    RotaryPump(
        "Incor",
        "Incor",
        "LVAD",
        a=2.7737e-6,
        R1=0.0010,
        R2=1.7742,
        Rrec=3.7529,
        kinf=3.9814e-5,
        L=32.4690,
        Rper=0.3154,
        Lper=18.3543,
        speed_range_rpm=(5000, 10000),
        evidence=f"{_NOTHING}; {_SPEEDS}",
    ),
)

PUMPS: MappingProxyType[str, RotaryPump] = MappingProxyType({pump.key: pump for pump in _PUMPS})
"""Rotary pumps by the name users write."""

PUMP_ALIASES: MappingProxyType[str, str] = MappingProxyType(
    {pump.name: key for key, pump in PUMPS.items() if pump.name != key} | {"HeartMate III": "HM3"}
)
"""Makers' names that are read as well, and the name they become."""

CANNULAE: MappingProxyType[str, CannulaType] = MappingProxyType(
    {
        "arterial": CannulaType(
            "arterial",
            "Getinge HLS arterial",
            (-0.030456333049244444, 1.9774531710227174, -43.294344692029995, 322.2590740213103),
            MappingProxyType({15: 23, 17: 23, 19: 23, 21: 23, 23: 23}),
            _CANNULA_EVIDENCE,
        ),
        "venous": CannulaType(
            "venous",
            "Getinge HLS venous",
            (-0.00036562314501620286, 0.06564659815559282, -2.910667319976905, 39.143496939439224),
            MappingProxyType({19: 38, 21: 55, 23: 55, 25: 55, 29: 55}),
            _CANNULA_EVIDENCE,
        ),
    }
)
"""Cannula types by the name users write."""

_OXYGENATORS = (
    Oxygenator("Quadrox-i Adult", 0.6744, 335.0, (0.5, 7.0), _LABEL),
    Oxygenator("Quadrox-i Small Adult", 0.5174, 295.0, (0.5, 5.0), _LABEL),
    Oxygenator("Nautilus MC3", 0.6312, None, None, _NOTHING),
)

OXYGENATORS: MappingProxyType[str, Oxygenator] = MappingProxyType({item.key: item for item in _OXYGENATORS})
"""Oxygenators by the name users write."""

DIALYZERS: MappingProxyType[str, Dialyzer] = MappingProxyType(
    {
        "Prismaflex filter": Dialyzer(
            "Prismaflex filter", 15.75, 105.0,
            "unvalidated: 52.5 mmHg at 200 mL/min; called M180 in the paper and M100 in the published code",
        )
    }
)  # fmt: skip
"""CRRT filters; a case's filter is set by Rcrrtfil."""

CRRT_ALARMS_MMHG: MappingProxyType[str, tuple[float, float]] = MappingProxyType(
    {"access": (-250.0, 250.0), "return": (-50.0, 350.0)}
)
"""Usual low and high pressure alarms [mmHg] of CRRT machines, by line (Thiel et al. 2025, Figures 5, 6)."""


def pumps_for(use: str) -> tuple[str, ...]:
    """Names of the pumps for "ECMO" or "LVAD"."""
    return tuple(key for key, pump in PUMPS.items() if pump.use == use)
