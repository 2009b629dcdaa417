"""Effects of infusion rates on the circulation: Emax curves, and the controller that applies them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.circuit.network import BLOOD_VOLUME, HEART_RATE
from eclsim.components.base import Key, Number, Values, value_of
from eclsim.parameters.regulation import UNSTRESSED, dose, sensitivity
from eclsim.regulation.reflex import InstantController

ACTS_ON = ("Emaxlv", "Emaxrv", "Rmc", "Rpmc", HEART_RATE, UNSTRESSED)
"""Parameters on which drugs act, in the order of `InfusedDrugs.in_effect`."""


class Effects(NamedTuple):
    """Effects of a drug, as natural logarithms of factors: 0.1 is an increase of about 10 %.

    Attributes:
        contractility: effect on `Emaxlv` and `Emaxrv`.
        systemic_resistance: effect on `Rmc`.
        pulmonary_resistance: effect on `Rpmc`.
        heart_rate: effect on the heart rate.
        veins: change of the systemic veins' unstressed volume, as a share of the patient's blood volume.
    """

    contractility: float = 0.0
    systemic_resistance: float = 0.0
    pulmonary_resistance: float = 0.0
    heart_rate: float = 0.0
    veins: float = 0.0


@dataclass(frozen=True)
class Drug:
    """An infused drug; at a dose d it has the share d^n / (d^n + half_dose^n) of its largest effects.

    Args:
        name: name in case files.
        half_dose: dose with half of the largest effects, in the unit of the dose, such as [ug/kg/min].
        steepness: n, Hill exponent.
        at_most: largest effects, at a very high dose.
        half_life_min: half-life of the dose in effect after the infusion stops [min].
        source: source of the effects.
        shape_source: source of half dose and steepness.
        half_life_source: source of the half-life.
    """

    name: str
    half_dose: float
    steepness: float
    at_most: Effects
    half_life_min: float
    source: str
    shape_source: str
    half_life_source: str

    def share(self, dose: Number) -> Number:
        """Share of the largest effects at a dose, 0 to 1; 0 at negative doses, which rounding can cause."""
        numbers = jnp if isinstance(dose, jax.Array) else np
        given = numbers.asarray(dose) >= 0.0
        relative = numbers.where(given, dose, self.half_dose) / self.half_dose
        part = numbers.where(given, relative**self.steepness, 0.0)
        return part / (1.0 + part)

    def effects(self, dose: Number) -> tuple[Number, ...]:
        """Effects at a dose, in the order of `Effects`."""
        share = self.share(dose)
        return tuple(share * most for most in self.at_most)


class DrugConstants(NamedTuple):
    """Dose of each drug times the patient's sensitivity, and the patient's blood volume [mL]."""

    doses: tuple[Number, ...]
    blood_volume_ml: Number


@dataclass(frozen=True)
class InfusedDrugs(InstantController[DrugConstants]):
    """Controller of all drugs: their factors are multiplied and their volume shifts added.

    Doses and sensitivities are parameters of the circuit.

    Args:
        drugs: drugs that can be given.
        doses: parameter of each drug's dose; by default "drugs." and its name.
        sensitivities: parameter by which each dose is multiplied; by default that of its name.
        blood_volume: the patient's blood volume [mL].
    """

    drugs: tuple[Drug, ...]
    doses: Key = ()
    sensitivities: Key = ()
    blood_volume: Key = BLOOD_VOLUME
    not_negative: ClassVar = ("doses", "sensitivities")

    def __post_init__(self) -> None:
        names = [drug.name for drug in self.drugs]
        for field, key in (("doses", dose), ("sensitivities", sensitivity)):
            if not getattr(self, field):
                object.__setattr__(self, field, tuple(map(key, names)))

    def constants(self, values: Values) -> DrugConstants:
        """Doses times the patient's sensitivities, and blood volume."""
        assert isinstance(self.doses, tuple)
        assert isinstance(self.sensitivities, tuple)
        pairs = zip(self.doses, self.sensitivities, strict=True)
        felt = tuple(values[dose] * values[factor] for dose, factor in pairs)
        return DrugConstants(felt, value_of(values, self.blood_volume))

    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: DrugConstants
    ) -> Sequence[Number]:
        """Parameters times their factors, and the shifted unstressed volume."""
        each = [drug.effects(dose) for drug, dose in zip(self.drugs, constants.doses, strict=True)]
        *logarithms, veins = (sum(effects, start=0.0) for effects in zip(*each, strict=True))
        heart, systemic, pulmonary, rate = map(jnp.exp, logarithms)
        *references, unstressed = values
        changed = (v * f for v, f in zip(references, (heart, heart, systemic, pulmonary, rate), strict=True))
        return [*changed, unstressed + veins * constants.blood_volume_ml]
