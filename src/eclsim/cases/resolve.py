"""From a case to the simulated model: its circuit, and a value for each parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.cases.fluid import fluid_values, haemoglobin
from eclsim.devices.registry import nominal_value, parameters
from eclsim.parameters.regulation import EXTRA_VOLUME, UNSTRESSED
from eclsim.patient.anthropometry import (
    AGE,
    SIZE,
    mean_height_weight,
    oxygen_consumption,
    total_blood_volume_ml,
)
from eclsim.patient.sites import DRAINED, SAME_IN_REGIONS

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cases.sections import Patient
    from eclsim.circuit.network import Circuit, Site
    from eclsim.patient.circulation import Anatomy


def anatomy_of(case: Case) -> Anatomy:
    """Return the options of the patient's anatomy beyond the published circulation."""
    from eclsim.patient.circulation import FLOW_COEFFICIENTS, Anatomy

    section = case.physiology
    if section is None:
        return Anatomy()
    stated = section.model_dump(exclude_none=True)

    def valves(defect: str) -> frozenset[str]:
        return frozenset(name for name in FLOW_COEFFICIENTS if stated.get(f"{name}_{defect}_cm2"))

    bronchial = section.bronchial_fraction > 0.0
    walls = section.collapsible_veins, section.pericardium
    return Anatomy(section.regional, bronchial, valves("regurgitation"), valves("stenosis"), *walls)


def divided_sites(case: Case) -> dict[str, str]:
    """Return the compartments of the patient that its anatomy has in place of the sites of a case."""
    anatomy = anatomy_of(case)
    nodes = dict(SAME_IN_REGIONS) if anatomy.regional else {}
    if anatomy.collapsible_veins:
        nodes = {**DRAINED, **{site: DRAINED.get(node, node) for site, node in nodes.items()}}
    return nodes


def _patient(case: Case) -> tuple[Circuit, dict[str, Site]]:
    """Return the patient's circuit, and the replacements for sites that its anatomy divides or changes."""
    from eclsim.patient.circulation import circulation, gas_exchanges

    anatomy = anatomy_of(case)
    patient = circulation(anatomy)
    if case.gas is not None:
        patient += gas_exchanges(anatomy, stores=case.solutes is not None)
    nodes: dict[str, Site] = {**divided_sites(case)}
    return _regulated(patient, case), nodes


def _regulated(patient: Circuit, case: Case) -> Circuit:
    """Return the patient with the reflexes, drugs and extra volume of the case."""
    shifted = {EXTRA_VOLUME, UNSTRESSED} & case.parameters.keys()
    if not (case.regulation or case.drugs or case.fluid or shifted):
        return patient
    from eclsim.drugs.published import with_drugs
    from eclsim.regulation.attach import REFLEXES, with_heart_rate_response, with_reflex, with_volume_offset
    from eclsim.regulation.oxygen import with_chemoreflex, with_hypoxic_vasoconstriction, with_local_control

    baroreflex = case.regulation if case.regulation and case.regulation.baroreflex is not None else None
    by_gases = case.regulation if case.gas else None
    chemoreflex = by_gases is not None and by_gases.chemoreflex is not None
    if baroreflex or chemoreflex or case.drugs or case.fluid or shifted:
        patient = with_volume_offset(patient)
    if chemoreflex:
        patient = with_chemoreflex(patient)
    elif baroreflex:
        patient = with_reflex(patient, REFLEXES[baroreflex.model])
    if by_gases is not None and {by_gases.hypoxic_vasodilation, by_gases.carbon_dioxide_response} != {None}:
        patient = with_local_control(patient)
    if by_gases is not None and by_gases.hypoxic_vasoconstriction is not None:
        patient = with_hypoxic_vasoconstriction(patient)
    patient = with_drugs(patient) if case.drugs else patient
    limited = case.regulation is not None and case.regulation.heart_rate_response is not None
    changed = chemoreflex or baroreflex or case.drugs
    return with_heart_rate_response(patient) if limited and changed else patient


def circuit_of(case: Case) -> Circuit:
    """Return the circuit of the patient with all connected devices."""
    circuit, nodes = _patient(case)
    for instance in case.instances():
        nodes |= instance.sites()
        circuit += instance.circuit()
    return with_sites(with_blood_of(case, circuit), nodes)


def with_blood_of(case: Case, circuit: Circuit) -> Circuit:
    """Return the circuit with what its blood does: viscosity with [fluid], a drug with [dialysed_drug]."""
    if case.fluid is not None:
        from eclsim.fluid.viscosity import with_viscosity

        circuit = with_viscosity(circuit)
    if case.dialysed_drug is not None:
        from eclsim.fluid.dialysed_drug import with_dialysed_drug

        circuit = with_dialysed_drug(circuit)
    return circuit


def switched_circuit(case: Case) -> tuple[Circuit, dict[str, float]]:
    """Return the circuit of a case with movable lines as switches, and the position of each switch.

    If all movable lines of a device are connected to one other device, each line gets a `Choice` of all that
    device's sites. Moving a line then changes a parameter value, not the circuit. Such devices come last.
    """
    from eclsim.circuit.network import Choice, Circuit

    instances = case.instances()
    (circuit, nodes), switched, chosen = _patient(case), Circuit(), dict[str, float]()
    nodes |= {site: node for instance in instances for site, node in instance.sites().items()}
    for instance in instances:
        at = {line: getattr(instance.section, line) for line in instance.device.lines}
        sites = next((s for o in instances if at and set(at.values()) <= set(s := o.sites())), None)
        if sites is None:
            circuit += instance.circuit()
            continue
        names = {line: instance.parameter(f"{instance.device.key}.{line}") for line in at}
        choices = {line: Choice(tuple(sites.values()), f"{instance.device.key}.{line}") for line in at}
        switched += replace(instance, section=instance.section.model_copy(update=choices)).circuit()
        chosen |= {names[line]: float(list(sites).index(site)) for line, site in at.items()}
    return with_sites(with_blood_of(case, circuit + switched), nodes), chosen


def with_sites(circuit: Circuit, nodes: Mapping[str, Site]) -> Circuit:
    """Replace device sites, such as "post_oxy", in a circuit by the compartments at these sites."""

    def node(site: Site) -> Site:
        return nodes.get(site, site) if isinstance(site, str) else site

    paths = (
        c if c.group == "patient" else replace(c, source=node(c.source), target=node(c.target))
        for c in circuit.connections
    )
    return replace(circuit, connections=tuple(paths)) if nodes else circuit


def resolve_parameters(case: Case) -> dict[str, float]:
    """Return all numbers of a case by name, in the units of the parameter tables and of device manufacturers.

    Defaults come from the parameter tables. Devices supply their own values, and the case's own parameters
    override both. Settings of a device, such as `ecmo.speed_rpm`, are present only if it is connected.

    Raises:
        UnsolvedFlowError: The case specifies a pump flow in place of a speed.
    """
    values = {key: parameter.value for key, parameter in parameters().items()}
    values["heart_rate_bpm"] = case.patient.heart_rate_bpm
    values["total_blood_volume_ml"] = blood_volume_ml(case.patient)
    for section in (case.physiology, case.regulation, case.drugs, case.dialysed_drug):
        values |= {} if section is None else section.values()
    if case.regulation is not None or case.drugs is not None:
        values[AGE] = case.patient.age_years
    if case.gas is not None:
        values["gas.vo2_ml_min"] = oxygen_consumption(*height_weight(case.patient))
        values |= {f"gas.{name}": number for name, number in case.gas.model_dump(exclude_none=True).items()}
        if case.patient.height_cm is not None and case.patient.weight_kg is not None:
            values |= dict(zip(SIZE, (case.patient.height_cm, case.patient.weight_kg), strict=True))
    for instance in case.instances():
        values |= instance.values(haemoglobin(case), case.gas is not None)
        common = {key: value for key, value in case.parameters.items() if instance.parameter(key) in values}
        values |= {instance.parameter(key): value for key, value in common.items()}
    return values | fluid_values(case, values, *height_weight(case.patient)) | case.parameters


@lru_cache(maxsize=256)
def nominal_values(circuit: Circuit) -> Mapping[str, float] | None:
    """Return the paper's parameters and usual device values; None if the circuit reads an unknown parameter.

    The search for a patient's periodic orbit starts from the orbit at these values, whatever was solved
    before.
    """
    known = {key: parameter.value for key, parameter in parameters().items()}
    known |= {"heart_rate_bpm": 90.0, "total_blood_volume_ml": 4500.0}
    chosen = {
        site.parameter
        for connection in circuit.connections
        for site in (connection.source, connection.target)
        if not isinstance(site, str)
    }
    result: dict[str, float] = {}
    for name in ("heart_rate_bpm", *circuit.parameter_names()):
        value = 0.0 if name in chosen else nominal_value(name)
        value = known.get(name) if value is None else value
        if value is None:
            return None
        result[name] = float(value)
    return MappingProxyType(result)


def height_weight(patient: Patient) -> tuple[float, float]:
    """Return height [cm] and weight [kg]: the patient's own, or the mean for sex and age."""
    if patient.height_cm is not None and patient.weight_kg is not None:
        return patient.height_cm, patient.weight_kg
    return mean_height_weight(patient.sex, patient.age_years)


def blood_volume_ml(patient: Patient) -> float:
    """Return the total blood volume of a patient [mL]."""
    return total_blood_volume_ml(patient.sex, patient.age_years, *height_weight(patient))
