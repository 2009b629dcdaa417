"""Outputs of gas exchange: arterial and mixed venous blood gases, oxygen supply and demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np

from eclsim.beat.compilation import StoredProgram
from eclsim.blood.gases import BloodGases, gases_with_contents
from eclsim.circuit.network import Circuit
from eclsim.components.exchangers import BLOOD
from eclsim.devices.description import GASES, BeatMeasures, Numbers, Output, gas_sample
from eclsim.gas.network import CONTENTS, gas_exchanges
from eclsim.outputs.measures import Measures
from eclsim.parameters.fluid import SOLUTES
from eclsim.units import ML_S_PER_L_MIN

STANDING_L_MIN = 1e-3
"""Mean flow below which blood counts as standing; its gases could not be sampled [L/min]."""
ARTERY = ("upper", "sart")
"""Compartment of the right radial artery: the first of these that a circuit has."""


def artery_of(circuit: Circuit) -> str:
    """Compartment whose blood is analysed as arterial."""
    names = [c.name for c in circuit.compartments]
    return next(name for name in ARTERY if name in names)


def _sum(m: BeatMeasures, gas: str, law: str) -> Numbers:
    """Sum of a quantity over all tissues, or over all lungs of the patient."""
    places = [e.at for e in m.circuit.exchanges if type(e.component).__name__ == law]
    return sum((m.gas(gas, "at", place) for place in places[1:]), m.gas(gas, "at", places[0]))


def _of_artery(name: str, label: str, unit: str, gas: str, factor: float = 1.0) -> Output:
    return Output(
        name, f"{label} of the right radial artery", unit,
        "of the blood in the systemic arteries (of the upper body, where there are two)", ("Qpas",),
        lambda m: factor * m.gas(gas, "in", artery_of(m.circuit)), parameters=(GASES,), all_flows=True,
        read_at=f"P{ARTERY[-1]}",
    )  # fmt: skip


def _total(name: str, label: str, unit: str, definition: str, gas: str, law: str, sign: float) -> Output:
    return Output(
        name, label, unit, definition, ("Qpas",), lambda m: sign * _sum(m, gas, law), parameters=(GASES,),
        all_flows=True, read_at="Qsart" if law == "Tissue" else "Qpart",
    )  # fmt: skip


def _tissue(suffix: str, at: str, label: str) -> tuple[Output, Output]:
    """Outputs of a tissue that stores carbon dioxide."""
    tissue = f"{suffix}_tissue".lstrip("_")
    known = (GASES, f"{SOLUTES}.{tissue}_pco2_mmHg", "gas.respiratory_quotient")
    end = f"_{suffix}" if suffix else ""

    def stored(m: BeatMeasures) -> Numbers:
        made = -1.0 * m.parameter("gas.respiratory_quotient") * m.gas("gained", "at", at)
        return made - m.gas("gained_co2", "at", at)

    return (
        Output(
            f"tissue_PCO2{end}", f"PCO2 of the blood that leaves {label}", "mmHg", f"behind {at}",
            (f"Q{at}",), lambda m: m.gas("PCO2", "behind", at), parameters=known, all_flows=True,
        ),
        Output(
            f"stored_CO2{end}", f"carbon dioxide that {label} store (STPD)", "mL/min",
            "production - release to the blood", (f"Q{at}",), stored, parameters=known, all_flows=True,
        ),
    )  # fmt: skip


_STPD = "mL/min"
GAS_OUTPUTS = (
    _of_artery("SaO2", "oxygen saturation", "%", "SO2", 100.0),
    _of_artery("PaO2", "PO2", "mmHg", "PO2"),
    _of_artery("PaCO2", "PCO2", "mmHg", "PCO2"),
    _of_artery("pHa", "pH", "1", "pH"),
    *(
        gas_sample(f"{name}_lower", f"{label} of the femoral artery", "in", "lower", what, ("Qlower",))
        for name, label, what in (
            ("SaO2", "oxygen saturation", "SO2"), ("PaO2", "PO2", "PO2"), ("PaCO2", "PCO2", "PCO2"),
        )
    ),
    gas_sample("PvO2", "PO2 in the pulmonary artery", "in", "pas", "PO2", ("Qpas",)),
    gas_sample("SvO2", "oxygen saturation in the pulmonary artery", "in", "pas", "SO2", ("Qpas",)),
    _total(
        "VO2", "oxygen consumption (STPD)", _STPD, "oxygen taken up by the tissues; below demand where the "
        "supply limits it", "gained", "Tissue", -1.0,
    ),
    _total(
        "VO2_lung", "oxygen uptake of the lungs (STPD)", _STPD, "gained by blood", "gained", "NativeLung", 1.0
    ),
    _total(
        "VCO2_lung", "carbon dioxide removed by the lungs (STPD)", _STPD, "lost by blood", "gained_co2",
        "NativeLung", -1.0,
    ),
    _total(
        "DO2", "oxygen delivery (STPD)", _STPD, "flow to the tissues times its oxygen content",
        "supplied", "Tissue", 1.0,
    ),
    Output(
        "O2ER", "oxygen extraction ratio", "1", "VO2 / DO2", ("Qpas",),
        lambda m: -1.0 * _sum(m, "gained", "Tissue") / _sum(m, "supplied", "Tissue"),
        parameters=(GASES,), all_flows=True, read_at="Qsart",
    ),
    *_tissue("", "sart", "the tissues"),
    *_tissue("upper", "upper", "tissues of the upper body"),
    *_tissue("lower", "lower", "tissues of the lower body"),
)  # fmt: skip


# --- every compartment of a beat ----------------------------------------------------------------

BLOCK = 16
"""Compartments are computed in multiples of this number, so that few programs serve all circuits."""


class PlaceGases(NamedTuple):
    """Gases in all places of a circuit in one beat.

    Attributes:
        places: blood by compartment: SO2 [-], PO2 and PCO2 [mmHg], pH, contents [mL/dL STPD].
        exchanged: oxygen and carbon dioxide gained by each connection that exchanges gas [mL/min STPD].
        standing: compartments through which no blood flows, whose gases could not be sampled.
    """

    places: Mapping[str, BloodGases]
    exchanged: Mapping[str, tuple[float, float]]
    standing: frozenset[str] = frozenset()


def gases_of_places(measures: Measures, member: int = 0) -> PlaceGases:
    """Return the gases of a member of a batch whose gas state is steady.

    Args:
        measures: measures of the batch.
        member: index of the member.
    """
    names = [c.name for c in measures.circuit.compartments]

    def of(number: object) -> float:
        return float(np.atleast_1d(np.asarray(number))[member])

    contents = np.ones((2, -(-len(names) // BLOCK) * BLOCK))
    contents *= np.array([[of(measures.gas(what, "mixed", names[0]))] for what in CONTENTS])
    for row, what in zip(contents, CONTENTS, strict=True):
        row[: len(names)] = [of(measures.gas(what, "mixed", name)) for name in names]
    result = _at_equilibrium(*contents, *(of(measures.parameter(name)) for name in BLOOD))
    table = np.stack([np.asarray(row) for row in result])
    places = {name: BloodGases(*table[:, k].tolist()) for k, name in enumerate(names)}
    exchanged = {
        e.at: (of(measures.gas("gained", "at", e.at)), of(measures.gas("gained_co2", "at", e.at)))
        for e in gas_exchanges(measures.circuit)
    }
    flows = {c.name: of(measures.mean(f"Q{c.name}")) for c in measures.circuit.connections}
    return PlaceGases(places, exchanged, _standing(measures.circuit, flows))


@jax.jit
def _with_contents(
    oxygen: jax.Array, carbon_dioxide: jax.Array, haemoglobin: jax.Array, excess: jax.Array,
    temperature: jax.Array, capacity: jax.Array,
) -> BloodGases:  # fmt: skip
    """Gases of blood with contents [mL/dL STPD]."""
    return gases_with_contents(
        oxygen=oxygen, carbon_dioxide=carbon_dioxide, haemoglobin=haemoglobin, base_excess=excess,
        temperature=temperature, oxygen_capacity=capacity,
    )  # fmt: skip


_at_equilibrium: Callable[..., BloodGases] = StoredProgram(  # pyright: ignore[reportAssignmentType]
    _with_contents, ("gases with contents",), (__name__,)
)
"""`_with_contents`, which takes 0.4 s to trace, from the disk."""


def _standing(circuit: Circuit, mean_flows: Mapping[str, float]) -> frozenset[str]:
    """Compartments that mean flows [mL/s] neither bring blood to nor take it from."""
    moving: dict[str, float] = {}
    for connection in circuit.connections:
        for site in connection.sites:
            moving[str(site)] = moving.get(str(site), 0.0) + abs(mean_flows[connection.name])
    least = 2.0 * STANDING_L_MIN * ML_S_PER_L_MIN  # sum of inflow and outflow
    return frozenset(place for place, flow in moving.items() if flow < least)
