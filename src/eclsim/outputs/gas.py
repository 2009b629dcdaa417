"""Outputs of gas exchange: arterial and mixed venous blood gases, oxygen supply, demand and recirculation.

Recirculation: share of the blood drawn by a device with movable lines that has just passed it.

Blood is marked where it leaves the return line. The balances of `eclsim.gas.transport`, also used for oxygen
and solutes, give the share of it that reaches the access line. If this line is in another device, blood from
the patient counts as fresh; if it is in the patient, blood that has passed the systemic capillaries does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from eclsim.beat.compilation import StoredProgram
from eclsim.blood.gases import BloodGases, gases_with_contents
from eclsim.circuit.network import Circuit, Connection
from eclsim.components.exchangers import BLOOD
from eclsim.devices.description import GASES, BeatMeasures, Numbers, Output, gas_sample
from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, instances_in
from eclsim.gas.network import CONTENTS, gas_exchanges
from eclsim.gas.tracers import sources
from eclsim.gas.transport import Flows, balanced, mixtures
from eclsim.outputs.measures import Measures
from eclsim.parameters.fluid import SOLUTES
from eclsim.units import ML_S_PER_L_MIN

STANDING_L_MIN = 1e-3
"""Mean flow below which blood counts as standing; its gases could not be sampled [L/min]."""
OF_LUNG_FLOW = ("SvO2", "PvO2")
"""Gases of mixed venous blood, which have no meaning where no blood flows through the lungs."""
LUNG_FLOW = "pulmonary_flow"
ARTERY = ("upper", "sart")
"""Compartment of the right radial artery: the first of these that a circuit has."""


def artery_of(circuit: Circuit) -> str:
    """Compartment whose blood is analysed as arterial."""
    names = [c.name for c in circuit.compartments]
    return next(name for name in ARTERY if name in names)


def lung_blood_stands(flow: Any) -> Any:
    """Whether the flow through the lungs [L/min] is that of blood which stands still; element by element."""
    return np.abs(flow) < STANDING_L_MIN


def of_moving_blood(outputs: Mapping[str, Any]) -> dict[str, Any]:
    """Outputs with NaN for the gases of mixed venous blood where none flows.

    What the search leaves there has no meaning, such as 100 % in an arrest on veno-arterial ECMO.

    Args:
        outputs: numbers by name; unchanged if the flow through the lungs is not among them.
    """
    if LUNG_FLOW not in outputs:
        return dict(outputs)
    stands = lung_blood_stands(outputs[LUNG_FLOW])
    lost = {n: np.where(stands, np.nan, outputs[n])[()] for n in OF_LUNG_FLOW if n in outputs}
    return {**outputs, **lost}


def _sum(m: BeatMeasures, gas: str, law: str) -> Numbers:
    """Sum of a quantity over all tissues, or over all lungs of the patient."""
    places = [e.at for e in m.circuit.exchanges if type(e.component).__name__ == law]
    return sum((m.gas(gas, "at", place) for place in places[1:]), m.gas(gas, "at", places[0]))


def _of_artery(name: str, label: str, unit: str, gas: str, factor: float = 1.0) -> Output:
    return Output(
        name, f"{label} of the right radial artery", unit,
        "of the blood in the systemic arteries (of the upper body, where there are two)", ("Qpas",),
        lambda m: factor * m.gas(gas, "in", artery_of(m.circuit)), parameters=(GASES,), all_flows=True,
        read_at=f"P{ARTERY[-1]}", saturation_in=ARTERY if gas == "SO2" else (),
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


# --- recirculation --------------------------------------------------------------------------------


DEFINITION = (
    "share of the access flow that comes from the return line without having passed through the patient; "
    "with the access line on the patient, without having passed through capillaries of the body (steady "
    "mixing)"
)
RECIRCULATED = ("recirculated_fraction", "recirculated_flow")
"""Ends of the names of a device's share and flow, which only `simulate` computes."""


Labelled = tuple[float, dict[str, str]]
"""A number and its labels: unit, long name and definition."""


def recirculated_fractions(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, float]:
    """Share of the access flow of each device with lines that came from its own return line.

    Args:
        circuit: circuit with fixed sites; devices whose lines have none are left out.
        mean_flows: mean flow of each connection [mL/s]; negative for backward flow.

    Returns:
        Shares by the key of the device's section.
    """
    shares = {names.key: _share(circuit, names, mean_flows) for names in instances_in(circuit)}
    return {key: share for key, share in shares.items() if share is not None}


def recirculation(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, Labelled]:
    """Share and flow [L/min] of each device with labels, by the name of the number."""
    result: dict[str, Labelled] = {}
    shares = recirculated_fractions(circuit, mean_flows)
    for names in instances_in(circuit):
        if names.key in shares:
            share, drawn = shares[names.key], mean_flows[names.pumps()[0]] / ML_S_PER_L_MIN
            values = (share, share * drawn)
            result |= {n: (v, about) for (n, about), v in zip(_labels(names).items(), values, strict=True)}
    return result


def recirculation_labels() -> dict[str, dict[str, str]]:
    """Units, long names and definitions of all such numbers by name."""
    single = map(Naming, devices().values())
    return {name: about for names in single if names.device.lines for name, about in _labels(names).items()}


def _labels(names: Naming) -> dict[str, dict[str, str]]:
    share, flow = f"recirculated share of the {names.label} flow", f"recirculated {names.label} flow"
    return {
        names.output(f"{names.device.key}_{what}"): {
            "units": unit, "long_name": long_name, "definition": DEFINITION,
        }
        for what, (unit, long_name) in zip(RECIRCULATED, (("1", share), ("L/min", flow)), strict=True)
    }  # fmt: skip


def _share(circuit: Circuit, names: Naming, mean_flows: Mapping[str, float]) -> float | None:
    lines = [circuit.connection(names.place(line)) for line in names.device.lines.values()]
    groups = {c.name: c.group for c in circuit.compartments}
    drawing = [c for c in lines if groups.get(str(c.target)) == names.key]
    returning = [c for c in lines if groups.get(str(c.source)) == names.key]
    if len(drawing) != 1 or len(returning) != 1 or not isinstance(returning[0].target, str):
        return None
    access, line_out = drawing[0].source, returning[0].name
    if not isinstance(access, str):
        return None
    mixed_in = groups[access]
    if mixed_in not in {other.key for other in instances_in(circuit)}:
        return _share_of_patient(circuit, access, line_out, mean_flows)
    place = {name: k for k, name in enumerate(n for n, group in groups.items() if group == mixed_in)}
    touching = [c for c in circuit.connections if place.keys() & {c.source, c.target}]
    flows = _flows(touching, place, len(place) + 1, mean_flows)
    if flows is None:
        return None
    inside = [place.keys() >= {c.source, c.target} for c in touching]
    through = [k for k, c in enumerate(touching) if not inside[k] and c.name != line_out]
    returned = [k for k, c in enumerate(touching) if c.name == line_out]
    shares = mixtures(flows, [*returned, *through]).compartments[place[access]]
    return float(shares[: len(returned)].sum())


def _share_of_patient(
    circuit: Circuit, access: str, line_out: str, mean_flows: Mapping[str, float]
) -> float | None:
    """Share in a compartment of the patient that came from a line and has passed no capillaries since."""
    place = {c.name: k for k, c in enumerate(circuit.compartments)}
    flows = _flows(circuit.connections, place, len(place), mean_flows)
    if flows is None:
        return None
    return float(mixtures(flows, sources(circuit, line_out)).compartments[place[access], -1])


def _flows(
    connections: Sequence[Connection], place: Mapping[str, int], count: int, mean_flows: Mapping[str, float]
) -> Flows | None:
    """Balanced flows between numbered compartments; None if a site is not fixed.

    In mL/s: the solver's exchange along standing blood is then below 1e-10 of these flows.

    Args:
        connections: connections between the compartments.
        place: number of each compartment; any other one has the last number.
        count: number of compartments.
        mean_flows: mean flow of each connection [mL/s].
    """
    if any(not isinstance(site, str) for c in connections for site in c.sites):
        return None
    ends = np.array([[place.get(str(site), count - 1) for site in (c.source, c.target)] for c in connections])
    leaves, enters = (np.eye(count)[side].T for side in ends.T)
    flow = np.array([mean_flows[c.name] for c in connections])
    forward, backward = np.maximum(flow, 0.0), np.maximum(-flow, 0.0)
    return balanced(Flows(leaves, enters, forward, backward))  # pyright: ignore[reportArgumentType]  # NumPy's
