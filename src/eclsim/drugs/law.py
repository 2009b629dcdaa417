"""From infusion rates to parameters of the circulation: Emax curves, and the controller that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.circuit.network import BLOOD_VOLUME, HEART_RATE
from eclsim.components.base import ControlState, Key, Number, Values, value_of
from eclsim.parameters.regulation import UNSTRESSED, dose, sensitivity
from eclsim.regulation.reflex import SteadyController

ACTS_ON = ("Emaxlv", "Emaxrv", "Rmc", "Rpmc", HEART_RATE, UNSTRESSED)
"""Parameters that drugs act on, in the order of `InfusedDrugs.in_effect`."""


class Effects(NamedTuple):
    """Effects of a drug, as natural logarithms of factors: 0.1 is about 10 % more.

    Attributes:
        contractility: of `Emaxlv` and `Emaxrv`.
        systemic_resistance: of `Rmc`.
        pulmonary_resistance: of `Rpmc`.
        heart_rate: of the heart rate.
        veins: change of the systemic veins' unstressed volume as a share of the patient's blood volume.
    """

    contractility: float = 0.0
    systemic_resistance: float = 0.0
    pulmonary_resistance: float = 0.0
    heart_rate: float = 0.0
    veins: float = 0.0


@dataclass(frozen=True)
class Drug:
    """An infused drug: share of its effects in use = d^n / (d^n + half_dose^n) at a dose d.

    Args:
        name: as in a case file.
        half_dose: with half of the effects [ug/kg/min].
        steepness: n, Hill's exponent.
        at_most: effects at a dose far beyond.
        half_life_min: of the dose in effect once the pump stops [min].
        source: where the effects come from.
        shape_source: where half dose and steepness come from.
        half_life_source: where the half-life comes from.
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
        """Share of the effects in use at a dose [ug/kg/min], 0 to 1; none below 0, where rounding leads."""
        given = jnp.asarray(dose) >= 0.0
        relative = jnp.where(given, dose, self.half_dose) / self.half_dose
        part = jnp.where(given, relative**self.steepness, 0.0)
        return part / (1.0 + part)

    def effects(self, dose: Number) -> tuple[Number, ...]:
        """Effects at a dose [ug/kg/min], in the order of `Effects`."""
        share = self.share(dose)
        return tuple(share * most for most in self.at_most)


class DrugConstants(NamedTuple):
    """Dose of each drug times the patient's sensitivity [ug/kg/min], and the patient's blood volume [mL]."""

    doses: tuple[Number, ...]
    blood_volume_ml: Number


@dataclass(frozen=True)
class InfusedDrugs(SteadyController[DrugConstants]):
    """The controller of all drugs: factors of several multiply, volumes shifted add up.

    It has no states and reads nothing: doses and sensitivities are parameters of the circuit.

    Args:
        drugs: what can be given.
        doses: parameter of each drug's dose [ug/kg/min]; left out, "drugs." and its name.
        sensitivities: parameter that each dose is multiplied by, likewise.
        blood_volume: the patient's blood [mL].
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

    @property
    def states(self) -> tuple[ControlState, ...]:
        """None."""
        return ()

    def constants(self, values: Values) -> DrugConstants:
        """Doses as this patient feels them."""
        assert isinstance(self.doses, tuple)
        assert isinstance(self.sensitivities, tuple)
        pairs = zip(self.doses, self.sensitivities, strict=True)
        felt = tuple(values[dose] * values[factor] for dose, factor in pairs)
        return DrugConstants(felt, value_of(values, self.blood_volume))

    def start(self, constants: DrugConstants) -> Sequence[Number]:
        """Nothing."""
        return ()

    def steady_states(self, readings: Sequence[Number], constants: DrugConstants) -> Sequence[Number]:
        """Nothing."""
        return ()

    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: DrugConstants
    ) -> Sequence[Number]:
        """Parameters times their factors, and the unstressed volume shifted."""
        each = [drug.effects(dose) for drug, dose in zip(self.drugs, constants.doses, strict=True)]
        *logarithms, veins = (sum(effects, start=0.0) for effects in zip(*each, strict=True))
        heart, systemic, pulmonary, rate = map(jnp.exp, logarithms)
        *references, unstressed = values
        changed = (v * f for v, f in zip(references, (heart, heart, systemic, pulmonary, rate), strict=True))
        return [*changed, unstressed + veins * constants.blood_volume_ml]

    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: DrugConstants
    ) -> Sequence[Number]:
        """Nothing."""
        return ()
