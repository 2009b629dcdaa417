"""Products of which devices consist: blood pumps, cannulae, oxygenators and dialyzers, with their data.

Constants are in the makers' units (rpm, L/min, mmHg). `evidence` says how far each product was compared with
independent data; if it begins with "unvalidated", results rest on the published constants alone.

Makers mostly measure cannula charts in water; in blood the flow at the same pressure is 3 to 21 % lower
(Broman et al., ECMO cannulae I and II).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, TypeVar

SOURCE = "published code of Thiel et al. 2025 (makers' data sheets; pump equation of Boes et al. 2019)"
UNVALIDATED = "unvalidated: no independent data found"


@dataclass(frozen=True, kw_only=True)
class Product(ABC):
    """A commercial product that a case file can name.

    Attributes:
        key: The name in case files.
        evidence: The data with which its constants were compared.
        source: Source of the constants.
        other_names: Other accepted spellings.
    """

    title: ClassVar[str]
    """Heading of the table of such products."""
    head: ClassVar[tuple[str, ...]]
    """Names of the table's columns; those with an index in `numeric` are right-aligned."""
    numeric: ClassVar[tuple[int, ...]] = ()
    remark: ClassVar[str] = ""
    """Remark below the table."""

    key: str
    evidence: str
    source: str = SOURCE
    other_names: tuple[str, ...] = ()

    @property
    def full_name(self) -> str:
        """The maker's name."""
        return self.key

    @abstractmethod
    def row(self) -> tuple[str, ...]:
        """Cells in the table of such products."""

    @abstractmethod
    def details(self) -> Iterator[str]:
        """Lines with all its data except evidence and source."""


@dataclass(frozen=True, kw_only=True)
class PumpCurve(Product):
    """The characteristic curve of a rotary blood pump.

    Head [mmHg] at speed n [rpm] and flow Q [L/min]:
    H = a n^2 - R1 n Q - R2 Q^2 + Rrec (Q - kinf n)^2, the last term only for Q < kinf n.

    Attributes:
        name: The maker's name.
        use: Intended use, such as "ECMO" or "LVAD".
        a: Head at zero flow per squared speed [mmHg/rpm^2].
        R1: Loss with speed times flow [mmHg/(rpm L/min)].
        R2: Loss with squared flow [mmHg/(L/min)^2].
        Rrec: Recirculation at low flow [mmHg/(L/min)^2].
        kinf: Flow per speed below which recirculation acts [(L/min)/rpm].
        speed_range_rpm: Lowest and highest speed in use.
        L: Inertance of the pump [mmHg s^2/L], for pumps with a graft.
        Rper: Resistance of the outflow graft [mmHg/(L/min)^2], likewise.
        Lper: Inertance of the outflow graft [mmHg s^2/L], likewise.
    """

    title = "Pumps"
    head = ("name", "device", "use", "speed [rpm]", "checked against")
    remark = "{ roller_l_min = 4.0 } instead of a name: a roller pump with this flow [L/min]"

    name: str
    use: str
    a: float
    R1: float
    R2: float
    Rrec: float
    kinf: float
    speed_range_rpm: tuple[float, float]
    L: float | None = None
    Rper: float | None = None
    Lper: float | None = None

    @property
    def full_name(self) -> str:
        """The maker's name."""
        return self.name

    @property
    def constants(self) -> dict[str, float]:
        """The constants of the pump equation, by name; inertial ones only where the pump has them."""
        names = ("a", "R1", "R2", "Rrec", "kinf", "L", "Rper", "Lper")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def usual_speed_rpm(self) -> float:
        """Middle of the speeds in use [rpm], rounded to 50 rpm."""
        low, high = self.speed_range_rpm
        return float(round((low + 0.5 * (high - low)) / 50.0) * 50)

    def head_mmhg(self, speed_rpm: float, flow_l_min: float) -> float:
        """Pressure head [mmHg] at a speed [rpm] and a flow [L/min]."""
        head = self.a * speed_rpm**2 - self.R1 * speed_rpm * flow_l_min - self.R2 * flow_l_min**2
        below = min(flow_l_min - self.kinf * speed_rpm, 0.0)
        return head + self.Rrec * below**2

    def row(self) -> tuple[str, ...]:
        """Cells in the table of pumps."""
        return self.key, self.name, self.use, _range(self.speed_range_rpm), self.evidence.partition(";")[0]

    def details(self) -> Iterator[str]:
        """Use, speed, curve and heads at three speeds."""
        low, high = self.speed_range_rpm
        yield f"  use                {self.use}"
        yield f"  speed              {_range(self.speed_range_rpm)} rpm"
        yield "  H = a n^2 - R1 n Q - R2 Q^2, and + Rrec (Q - kinf n)^2 below Q = kinf n"
        yield "  with H in mmHg, n in rpm, Q in L/min and"
        yield from (f"    {name:<6} {value:g}" for name, value in self.constants.items())
        for speed in (low, 0.5 * (low + high), high):
            heads = ", ".join(f"{self.head_mmhg(speed, flow):.0f} at {flow}" for flow in (0, 2, 4, 6))
            yield f"  head at {speed:g} rpm: {heads} L/min [mmHg]"


@dataclass(frozen=True, kw_only=True)
class CannulaType(Product):
    """A family of cannulae: flow Q [L/min] = sqrt(dP / R), R a cubic in the French size.

    Attributes:
        name: The maker's name.
        coefficients: Of D^3, D^2, D and 1, D in Fr, R in mmHg/(L/min)^2.
        length_cm: Length [cm] of each size that the maker lists [Fr]; None if not known.
        dual_lumen: The maker's name of the dual-lumen cannula whose lumen this is; empty for others.
    """

    title = "Cannulae"
    head = ("name", "device", "sizes [Fr]", "checked against")

    name: str
    coefficients: tuple[float, float, float, float]
    length_cm: Mapping[int, float | None]
    dual_lumen: str = ""

    @property
    def full_name(self) -> str:
        """The maker's name."""
        return self.name

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

    def row(self) -> tuple[str, ...]:
        """Cells in the table of cannulae."""
        return self.key, self.name, ", ".join(map(str, self.sizes_fr)), self.evidence

    def details(self) -> Iterator[str]:
        """Length and pressure drops of each size, one line per size."""
        yield "  size [Fr], length [cm], pressure drop [mmHg] at 2 and 4 L/min"
        for size, length in self.length_cm.items():
            drops = f"{self.pressure_drop_mmhg(size, 2):5.0f} {self.pressure_drop_mmhg(size, 4):5.0f}"
            yield f"    {size:3d} {'?' if length is None else f'{length:g}':>4} {drops}"


@dataclass(frozen=True, kw_only=True)
class Exchanger(Product):
    """Housing with fibres and a linear pressure drop.

    Attributes:
        resistance: resistance [mmHg s/mL].
        priming_volume_ml: priming volume [mL]; None if not known.
    """

    resistance: float
    priming_volume_ml: float | None

    def details(self) -> Iterator[str]:
        """Resistance and priming volume."""
        yield f"  resistance         {self.resistance:g} mmHg s/mL"
        yield f"  priming volume     {_number(self.priming_volume_ml)} mL"


@dataclass(frozen=True)
class Membrane:
    """Membrane for gas exchange.

    Attributes:
        highest_flow_l_min: rated flow [L/min], at which it raises blood of saturation 0.65 (12 g/dL, PCO2
            45 mmHg, 37 C) to 0.99 with as much pure oxygen as blood.
        oxygen_transfer: oxygen transfer coefficient [mL/min/mmHg at 1 L/min].
        carbon_dioxide_transfer: carbon dioxide transfer coefficient [mL/min/mmHg at 1 L/min].
    """

    highest_flow_l_min: float
    oxygen_transfer: float
    carbon_dioxide_transfer: float


@dataclass(frozen=True, kw_only=True)
class Oxygenator(Exchanger):
    """Oxygenator.

    Attributes:
        label_flow_l_min: lowest and highest flow of its label [L/min]; None if not known.
        membrane: its membrane for gas exchange.
    """

    title = "Oxygenators"
    head = ("name", "R [mmHg s/mL]", "label flow [L/min]", "priming [mL]", "checked against")
    numeric = (1, 3)

    label_flow_l_min: tuple[float, float] | None
    membrane: Membrane

    def gas_values(self) -> dict[str, float]:
        """Values of its gas exchange parameters."""
        return {
            "ecmo.oxygenator.oxygen_transfer": self.membrane.oxygen_transfer,
            "ecmo.oxygenator.carbon_dioxide_transfer": self.membrane.carbon_dioxide_transfer,
        }

    def label_values(self) -> dict[str, float]:
        """Flows of its label [L/min] by parameter name; NaN without a label."""
        return dict(zip(LABEL_FLOWS, self.label_flow_l_min or (math.nan, math.nan), strict=True))

    def label_warning(self, flow_l_min: float) -> str | None:
        """Warning for a flow [L/min] outside the label; None if it is inside or there is no label."""
        low, high = self.label_values().values()
        if beyond_label(flow_l_min, low, high) is None:
            return None
        return f"{flow_l_min:.3g} L/min is outside the label of the {self.key}, {low:g} to {high:g} L/min"

    def row(self) -> tuple[str, ...]:
        """Cells in the table of oxygenators."""
        volume = _number(self.priming_volume_ml)
        return self.key, f"{self.resistance:g}", _range(self.label_flow_l_min), volume, self.evidence

    def details(self) -> Iterator[str]:
        """Resistance, priming volume, label flows and membrane."""
        yield from super().details()
        yield f"  label flow         {_range(self.label_flow_l_min)} L/min"
        yield f"  highest flow       {self.membrane.highest_flow_l_min:g} L/min"
        yield f"  O2 transfer        {self.membrane.oxygen_transfer:g} mL/min/mmHg at 1 L/min"
        yield f"  CO2 transfer       {self.membrane.carbon_dioxide_transfer:g} mL/min/mmHg at 1 L/min"


@dataclass(frozen=True, kw_only=True)
class Dialyzer(Exchanger):
    """Filter for renal replacement therapy."""

    title = "CRRT filters (set by the parameter Rcrrtfil)"
    head = ("name", "R [mmHg s/mL]", "priming [mL]", "checked against")
    numeric = (1, 2)

    def row(self) -> tuple[str, ...]:
        """Cells in the table of filters."""
        return self.key, f"{self.resistance:g}", _number(self.priming_volume_ml), self.evidence


LABEL_FLOWS = ("ecmo.oxygenator.lowest_flow_l_min", "ecmo.oxygenator.highest_flow_l_min")


def beyond_label(flow_l_min: float, low: float, high: float) -> float | None:
    """The limit of a label [L/min] that a flow exceeds; None if inside or if the limits are NaN."""
    rounded = float(f"{flow_l_min:.3g}")  # as it is shown: a roller pump at the limit is within it
    return low if rounded < low else high if rounded > high else None


P = TypeVar("P", bound=Product)


def pump_values(device: str, pump: PumpCurve) -> dict[str, float]:
    """Constants of a pump's curve by the parameter names that `RotaryPump` reads."""
    return {f"{device}.pump.{name}": value for name, value in pump.constants.items()}


def by_key(products: Iterable[P]) -> MappingProxyType[str, P]:
    """Products by key (the name in case files)."""
    return MappingProxyType({product.key: product for product in products})


def makers_names(products: Iterable[Product]) -> Mapping[str, str]:
    """Other accepted names, and the key of each."""
    names = {name: p.key for p in products for name in (p.full_name, *p.other_names) if name != p.key}
    return MappingProxyType(names)


def _range(limits: tuple[float, float] | None) -> str:
    return f"{limits[0]:g} to {limits[1]:g}" if limits else "not known"


def _number(value: float | None) -> str:
    return f"{value:g}" if value is not None else "not known"
