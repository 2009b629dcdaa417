"""Chemoreflex, and local responses of organs to oxygen and carbon dioxide (Magosso and Ursino 2001).

Am J Physiol Heart Circ Physiol 281:H2036, after Ursino and Magosso 2000 (Am J Physiol 279:H149, H166). The
numbers are from public programs that reimplement the models and reproduce the articles' tables, not from the
articles themselves.

Chemoreceptors, at the arterial PO2 and PCO2 of the carotid bodies [mmHg]:

    f_ac = (f_max + f_min e^x) / (1 + e^x) (K ln(PCO2 / 40) + 1.4),  x = (PO2 - 45) / 29.27
    K = 3 above 80 mmHg, 3 - 1.2 (PO2 - 80) / 30 from 80 to 40, 4.6 below

Hypoxia and hypercapnia of the brain lower the offset of sympathetic nerves to heart, vessels and veins:

    theta = theta_n - x / (1 + e^((PO2 - P_0) / k)) - g (PCO2 - 40)
    sympathetic firing  f_inf + (f_0 - f_inf) e^(k_es (-f_cs + W f_ac - theta)),  at most 60
    vagal firing        as in the baroreflex + 0.2 f_ac

Conductances of organs relative to those at the set point, with venous oxygen content C [mL/dL]:

    brain           1 + x_O2 + F(PCO2) / F(PCO2_n) - 1,  F = 20.9 + 92.8 / (1 + 10570 e^(-5.251 log10 PCO2))
    heart, muscle   (1 + x_O2) / (1 - tanh((PCO2 - PCO2_n) / 2 K)),  x_O2 = -g (C - C_n)

In the programs K falls to 1.4 below 40 mmHg, which makes it discontinuous; 4.6 makes it continuous. Their F
has the natural logarithm, with which it does not depend on PCO2; with log10 it is the curve of Reivich 1964.

In humans the published response of the nerves to carbon dioxide has the wrong sign. `carbon_dioxide_response`
s replaces it, and that of the organs, by the net response measured in sedated, ventilated patients:

    factor of all resistances  e^(-s a L tanh((PCO2 - PCO2_n) / L)),  L = 40 mmHg
    PCO2 in the published responses  PCO2_n + (1 - s) (PCO2 - PCO2_n)

a is chosen so that with a baroreflex gain of one half (sedation) resistance falls by 25 % from 40 to 59 mmHg
(Thorens 1996, 11 patients). Resistance of the lung is unchanged, as in three studies of patients.

Hypoxic pulmonary vasoconstriction: resistance of the lung as a function of its PO2.

    stimulus  P_S = P_v^0.41 P_A^0.59  of mixed venous and alveolar PO2 [mmHg]
    share of the largest response  s = P_S^-2.616 / (6.683e-5 + P_S^-2.616)
    resistance relative to that without hypoxia  r = 1 + 2.15 s

Marshall 1994 (10.1016/0034-5687(94)90129-5), dogs, at constant flow. Blood that passes no ventilated alveolus
(the shunt) is exposed to the mixed venous PO2 only; both paths are in parallel. In six healthy men at an
end-tidal PO2 of 50 instead of 100 mmHg, resistance rose by 44 % in half an hour and by 137 % in two hours
(Dorrington 1997, Am J Physiol 273:H1126): the slow part of the response is not modelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, cast

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.circuit.network import Circuit, Connection, Control
from eclsim.components import Artery
from eclsim.components.base import Key, Number, PartTimes, Scaled, Values, names_in, value_of
from eclsim.components.exchangers import TEMPERATURE, dry_gas_pressure, stpd_of_btps
from eclsim.parameters import regulation as keys
from eclsim.parameters.regulation import CHEMOREFLEX, LUNG_RESISTANCE, REGULATION
from eclsim.regulation import ursino1998
from eclsim.regulation.reflex import Reflex, ReflexConstants
from eclsim.regulation.ursino1998 import URSINO_1998
from eclsim.slow import Named, SlowLaw, SlowState

MOST_FIRING, LEAST_FIRING, MIDDLE_MMHG, SLOPE_MMHG = 12.3, 0.835, 45.0, 29.27
NORMAL_PCO2, GAIN_HIGH, CARBON_DIOXIDE_BASE = 40.0, 3.0, 1.4
LARGEST_SYMPATHETIC = 60.0
"""Upper limit of sympathetic firing [1/s]; 80 in one of the programs."""
VAGAL_WEIGHT = 0.2
RECEPTORS_S, ORGANS_OXYGEN_S, ORGANS_CARBON_DIOXIDE_S = 2.0, 10.0, 20.0
"""Time constants of chemoreceptors and of the organs' responses to both gases [s]."""
MEASURED_PER_MMHG, MEASURED_RANGE_MMHG = 0.022, 40.0
"""a [1/mmHg], and L [mmHg], at which the response saturates: twice the range studied."""
LEAST_CONDUCTANCE = 0.05
"""Lower limit of a bed's conductance as a share of that at rest, to keep it above zero."""
CORONARY_RESERVE = 5.0
"""Upper limit of the heart's conductance relative to rest (textbook: four to five, not verified). Its
published law rises without limit with PCO2; the brain's is bounded, and muscle's hardly rises."""


class Outflow(NamedTuple):
    """Sympathetic outflow to a group of organs.

    Attributes:
        chemoreceptors: weight of the chemoreceptors' firing.
        most: largest effect of cerebral hypoxia [1/s].
        middle: PO2 of half of that effect [mmHg].
        slope: width of its PO2 dependence [mmHg].
        per_mmhg: effect of cerebral PCO2 [1/s per mmHg].
    """

    chemoreceptors: float
    most: float
    middle: float
    slope: float
    per_mmhg: float


HEART = Outflow(1.0, 53.0, 45.0, 6.0, 1.0)
VESSELS = Outflow(1.716, 6.0, 30.0, 2.0, 1.5)
VEINS = Outflow(1.716, 6.0, 30.0, 2.0, 0.0)
OUTFLOWS = (HEART, VESSELS, VEINS, HEART)
"""Outflows in the order of the sympathetic pathways of `ursino1998`."""


class Gases(NamedTuple):
    """PO2 and PCO2 [mmHg]."""

    oxygen: Number
    carbon_dioxide: Number


def chemoreceptor_firing(gases: Gases) -> Number:
    """Firing of peripheral chemoreceptors [1/s]."""
    rise = jnp.exp((gases.oxygen - MIDDLE_MMHG) / SLOPE_MMHG)
    by_oxygen = (MOST_FIRING + LEAST_FIRING * rise) / (1.0 + rise)
    gain = GAIN_HIGH - 1.2 * (jnp.clip(gases.oxygen, 40.0, 80.0) - 80.0) / 30.0
    by_carbon_dioxide = gain * jnp.log(gases.carbon_dioxide / NORMAL_PCO2) + CARBON_DIOXIDE_BASE
    return by_oxygen * jnp.maximum(by_carbon_dioxide, 0.0)


def sympathetic_input(outflow: Outflow, gases: Gases) -> Number:
    """Input from gases to sympathetic nerves [1/s]."""
    central = outflow.most / (1.0 + jnp.exp((gases.oxygen - outflow.middle) / outflow.slope))
    central = central + outflow.per_mmhg * (gases.carbon_dioxide - NORMAL_PCO2)
    return outflow.chemoreceptors * chemoreceptor_firing(gases) + central


def sympathetic_effect(deviation: Number, added: Number) -> Number:
    """Factor of the gains of sympathetic effectors with an added input from gases [1/s]."""
    least = ursino1998.SYMPATHETIC_AT_HIGH_PRESSURE
    span = ursino1998.sympathetic_firing(ursino1998.carotid_firing(deviation)) - least
    firing = jnp.minimum(least + span * jnp.exp(ursino1998.SYMPATHETIC_RATE * added), LARGEST_SYMPATHETIC)
    return jnp.log(jnp.maximum(firing - ursino1998.THRESHOLD + 1.0, 1.0))


def gas_drives(deviation: Number, strength: Number, now: Gases, rest: Gases) -> list[Number]:
    """Change of the drive along each pathway of `ursino1998` by gases at an arterial pressure deviation."""
    before = sympathetic_effect(deviation, 0.0)
    added = [strength * (sympathetic_input(o, now) - sympathetic_input(o, rest)) for o in OUTFLOWS]
    vagal = VAGAL_WEIGHT * strength * (chemoreceptor_firing(now) - chemoreceptor_firing(rest))
    return [*(sympathetic_effect(deviation, more) - before for more in added), vagal]


class ChemoreflexConstants(NamedTuple):
    """Baroreflex constants at a gain of 1; its own gain, chemoreflex strength, gases now and at rest."""

    gain: Number
    set_points: tuple[Number, ...]
    blood_volume_ml: Number
    baroreflex: Number
    strength: Number
    now: Gases
    rest: Gases


def _published_pco2(pco2: Number, rest: Number, response: Number) -> Number:
    """PCO2 [mmHg] in the published responses if the share `response` is replaced by the measured one."""
    return rest + (1.0 - response) * (pco2 - rest)


@dataclass(frozen=True)
class Chemoreflex(Reflex):
    """Baroreflex of Ursino 1998 with further nerve input from chemoreceptors and cerebral gases.

    With a baroreflex gain of 0, pressure is taken to be at the set point.

    Args:
        strength: 1 as published, 0 none.
        sensed_oxygen: arterial PO2 [mmHg].
        sensed_carbon_dioxide: arterial PCO2 [mmHg].
        oxygen_set_point: PO2 without effect [mmHg].
        carbon_dioxide_set_point: PCO2 without effect [mmHg].
        carbon_dioxide_response: share of the measured response to PCO2, which these nerves do not mediate.
    """

    strength: Key = CHEMOREFLEX
    sensed_oxygen: Key = keys.SENSED_PAO2
    sensed_carbon_dioxide: Key = keys.SENSED_PACO2
    oxygen_set_point: Key = keys.PAO2_SET_POINT
    carbon_dioxide_set_point: Key = keys.PACO2_SET_POINT
    carbon_dioxide_response: Key = keys.CARBON_DIOXIDE

    def constants(self, values: Values) -> ReflexConstants:
        """Constants of the baroreflex and chemoreflex, and gases."""
        constants = super().constants(values)
        now, rest = (
            Gases(value_of(values, oxygen), value_of(values, carbon_dioxide))
            for oxygen, carbon_dioxide in (
                (self.sensed_oxygen, self.sensed_carbon_dioxide),
                (self.oxygen_set_point, self.carbon_dioxide_set_point),
            )
        )
        response = value_of(values, self.carbon_dioxide_response)
        now = now._replace(carbon_dioxide=_published_pco2(now.carbon_dioxide, rest.carbon_dioxide, response))
        strength = value_of(values, self.strength)
        more = ChemoreflexConstants(
            1.0, constants.set_points, constants.blood_volume_ml, constants.gain, strength, now, rest
        )
        return cast(ReflexConstants, more)

    def steady_states(self, readings: Sequence[Number], constants: ReflexConstants) -> Sequence[Number]:
        """Drives due to the pressure read, and to the gases at that pressure."""
        c = cast(ChemoreflexConstants, constants)
        deviation = readings[0] - c.set_points[0]
        pressure = super().steady_states(readings, constants)
        gases = gas_drives(c.baroreflex * deviation, c.strength, c.now, c.rest)
        return [c.baroreflex * p + g for p, g in zip(pressure, gases, strict=True)]


class Organ(NamedTuple):
    """Vascular bed of an organ.

    Attributes:
        share: share of the systemic conductance.
        per_content: g, change of relative conductance per oxygen content [dL/mL].
        scale_mmhg: K of its response to PCO2 [mmHg]; None for the brain's curve.
        most: largest conductance relative to that at rest.
    """

    share: float
    per_content: float
    scale_mmhg: float | None
    most: float = math.inf


_CONDUCTANCE = sum(1.0 / resistance for resistance in URSINO_1998.effector("Rmc").reference)
ORGANS = (
    Organ(1.0 / 6.57 / _CONDUCTANCE, 0.10, None),
    Organ(1.0 / 19.71 / _CONDUCTANCE, 0.35, 11.11, CORONARY_RESERVE),
    Organ(1.0 / 4.48 / _CONDUCTANCE, 0.30, 142.8),
)
"""Brain, heart and muscle: resistances 6.57, 19.71 and 4.48 mmHg s/mL of the published subject."""


def brain_flow(pco2: Number) -> Number:
    """Cerebral flow at a PCO2 [mmHg] in arbitrary units (Reivich 1964)."""
    return 20.9 + 92.8 / (1.0 + 10570.0 * jnp.exp(-5.251 * jnp.log10(pco2)))


def organ_conductance(organ: Organ, content: Number, pco2: Number, rest: tuple[Number, Number]) -> Number:
    """Conductance of an organ relative to that at rest.

    Args:
        organ: the organ.
        content: oxygen content of its venous blood [mL/dL].
        pco2: arterial PCO2 [mmHg].
        rest: content and PCO2 at the set point.
    """
    oxygen = 1.0 - organ.per_content * (content - rest[0])
    if organ.scale_mmhg is None:
        response = oxygen + brain_flow(pco2) / brain_flow(rest[1]) - 1.0
    else:
        response = oxygen / (1.0 - jnp.tanh(0.5 * (pco2 - rest[1]) / organ.scale_mmhg))
    return jnp.minimum(jnp.maximum(response, LEAST_CONDUCTANCE), organ.most)


def local_factor(content: Number, pco2: Number, rest: tuple[Number, Number], strength: Number) -> Number:
    """Factor of the resistance of all organs in parallel; arguments as of `organ_conductance`."""
    others = 1.0 - sum(organ.share for organ in ORGANS)
    conductances = (organ.share * organ_conductance(organ, content, pco2, rest) for organ in ORGANS)
    return jnp.exp(-strength * jnp.log(sum(conductances, start=others)))


def measured_factor(pco2: Number, rest: Number, response: Number) -> Number:
    """Factor of all resistances at a PCO2 [mmHg], as measured in ventilated patients.

    Thorens, Jolliet, Ritz and Chevrolet 1996 (Intensive Care Med 22:182, PMID 8727430): 11 patients with
    acute respiratory distress, sedated, PaCO2 40 to 59 mmHg. Outside this range it is extrapolated.
    """
    change = MEASURED_RANGE_MMHG * jnp.tanh((pco2 - rest) / MEASURED_RANGE_MMHG)
    return jnp.exp(-response * MEASURED_PER_MMHG * change)


def local_settings(bed: str) -> tuple[str, str, str, str]:
    """Parameters, other than gases, of a bed's factor, in the order of `local_law`."""
    set_points = keys.of_bed(keys.VENOUS_O2_SET_POINT, bed), keys.paco2_set_point(bed)
    return keys.DILATION, *set_points, keys.CARBON_DIOXIDE


def local_law(n: Array) -> Array:
    """Factor from arterial content, oxygen supplied and gained, PCO2 and `local_settings`."""
    published = _published_pco2(n[3], n[6], n[7])
    factor = local_factor(venous_content(n[0], n[1], n[2]), published, (n[5], n[6]), n[4])
    return jnp.stack([factor * measured_factor(n[3], n[6], n[7])])


def venous_content(arterial: Number, supplied: Number, gained: Number) -> Number:
    """Venous oxygen content of organs [mL/dL]; `gained` is negative."""
    return arterial * (1.0 + gained / supplied)


def with_chemoreflex(circuit: Circuit) -> Circuit:
    """Add a chemoreflex, and a baroreflex whose gain may be 0, to a circuit with volume offset."""
    control = Control(REGULATION, Chemoreflex(URSINO_1998), URSINO_1998.reads, URSINO_1998.acts_on)
    return circuit + Circuit(controllers=(control,))


def with_local_control(circuit: Circuit) -> Circuit:
    """Add local responses of each bed to its own oxygen and carbon dioxide."""
    return _with_factor(circuit, "Rmc", keys.local_resistance, local_settings, keys.BEDS)


def with_hypoxic_vasoconstriction(circuit: Circuit) -> Circuit:
    """Add hypoxic pulmonary vasoconstriction to a circuit."""
    settings = (keys.HYPOXIA, keys.LUNG_AT_REST)
    return _with_factor(circuit, "Rpmc", lambda _: keys.LUNG_RESISTANCE, lambda _: settings, ("part",))


def _with_factor(
    circuit: Circuit,
    part: str,
    factor: Callable[[str], str],
    settings: Callable[[str], tuple[str, ...]],
    at: Sequence[str],
) -> Circuit:
    def changed(connection: Connection) -> Connection:
        law = connection.component
        if connection.name not in at or not isinstance(law, Artery) or part not in names_in(law.ohmic):
            return connection
        total = law.ohmic.of if isinstance(law.ohmic, Scaled) else law.ohmic
        product = PartTimes(total, part, factor(connection.name), settings(connection.name))
        ohmic = replace(law.ohmic, of=product) if isinstance(law.ohmic, Scaled) else product
        return replace(connection, component=replace(law, ohmic=ohmic))

    return replace(circuit, connections=tuple(map(changed, circuit.connections)))


# --- hypoxic vasoconstriction of the lung ---------------------------------------------------------


VENOUS, ALVEOLAR = 0.41, 0.59
EXPONENT, HALF_EFFECT, LARGEST = -2.616, 6.683e-5, 3.15
LAG_S = 300.0
"""Time constant of the rapid part of the response [s]: minutes; not verified."""
LEAST_MMHG = 1.0
LUNG_SETTINGS = ("gas.alveolar_ventilation_l_min", "gas.fio2", "gas.shunt_fraction", TEMPERATURE)
WANTED_RESISTANCE = "hypoxic_resistance_wanted"
"""Name of the output of the relative resistance that the present PO2 leads to in the steady state."""


def relative_resistance(venous: Number, alveolar: Number) -> Number:
    """Resistance relative to that without hypoxia, from mixed venous and alveolar PO2 [mmHg]."""
    stimulus = jnp.maximum(venous, LEAST_MMHG) ** VENOUS * jnp.maximum(alveolar, LEAST_MMHG) ** ALVEOLAR
    return 1.0 + (LARGEST - 1.0) / (1.0 + HALF_EFFECT * stimulus**-EXPONENT)


def alveolar_po2(venous: Number, uptake: Number, gained_co2: Number, settings: Sequence[Number]) -> Number:
    """PO2 of ventilated alveoli [mmHg], from the balance of the gases exchanged.

    Args:
        venous: mixed venous PO2 [mmHg], which is that of alveoli without ventilation.
        uptake: oxygen that blood gains [mL/min].
        gained_co2: carbon dioxide that blood gains, negative [mL/min].
        settings: values of `LUNG_SETTINGS`.
    """
    dry, gas = dry_gas_pressure(settings[3]), 1000.0 * stpd_of_btps(settings[3]) * settings[0]
    expired = jnp.where(gas > 0.0, gas - uptake - gained_co2, 1.0)
    return jnp.where(gas > 0.0, dry * (gas * settings[1] - uptake) / expired, venous)


def lung_resistance(venous: Number, uptake: Number, gained_co2: Number, settings: Sequence[Number]) -> Number:
    """Resistance of ventilated lung and shunt in parallel, relative to that without hypoxia."""
    shunt = settings[2]
    ventilated = relative_resistance(venous, alveolar_po2(venous, uptake, gained_co2, settings))
    return 1.0 / ((1.0 - shunt) / ventilated + shunt / relative_resistance(venous, venous))


def lung_law(n: Array) -> Array:
    """Resistance factor from mixed venous PO2, both gases gained, `LUNG_SETTINGS`, strength, rest."""
    now = lung_resistance(n[0], n[1], n[2], (n[3], n[4], n[5], n[6]))
    return jnp.stack([jnp.exp(n[7] * jnp.log(now / n[8]))])


@dataclass(frozen=True)
class HypoxicVasoconstriction(SlowLaw):
    """Slow law of hypoxic vasoconstriction; its state is the logarithm of the lung's resistance factor."""

    factor: str = f"{REGULATION}.hypoxic_resistance_log"

    @property
    def states(self) -> tuple[SlowState, ...]:
        """The logarithm of the factor."""
        return (SlowState(self.factor, "1", "logarithm of the lung's resistance by hypoxia", 0.1),)

    @property
    def reads(self) -> tuple[str, ...]:
        """Output of the relative resistance that the present PO2 leads to."""
        return (WANTED_RESISTANCE,)

    def start(self, settings: Named, beat: Named) -> Named:
        """Start in the steady state."""
        return {self.factor: np.log(beat[WANTED_RESISTANCE])}

    def in_effect(self, states: Named, settings: Named) -> Named:
        """The factor, which is then not solved for with the beat."""
        return {LUNG_RESISTANCE: np.exp(states[self.factor])}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Rate towards the value that the present PO2 leads to; zero if that is not known."""
        target = np.asarray(beat[WANTED_RESISTANCE])
        known = target > 0.0
        return {
            self.factor: np.where(known, np.log(np.where(known, target, 1.0)) - states[self.factor], 0.0)
            / LAG_S
        }
