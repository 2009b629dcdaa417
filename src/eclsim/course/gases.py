"""Gases of the blood beat by beat, and the lagged responses to them.

Every beat is an implicit step of the oxygen and carbon dioxide contents of all compartments, with the flows
of the beat (`eclsim.gas.transport`): a change reaches the next compartment as its blood is renewed. Alveoli
hold gas that is inhaled, taken up and exhaled. Membrane and tissues respond at once to the blood that passes.
Infused blood has the contents of the veins. Where haemoglobin changes, its oxygen changes with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.circuit.volumes import total_volumes
from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.gas.network import CONTENTS, PATIENT, GasFunction, Quantity, gas_of, lungs_of
from eclsim.outputs.coupling import solved_for
from eclsim.outputs.gas import artery_of
from eclsim.outputs.measures import Measures, single
from eclsim.outputs.regulation import LOCAL_OUTPUTS
from eclsim.parameters.gas import LUNG_VOLUME
from eclsim.parameters.regulation import LUNG_RESISTANCE, SENSED_PACO2, SENSED_PAO2, local_resistance
from eclsim.regulation.oxygen import (
    ORGANS_CARBON_DIOXIDE_S,
    ORGANS_OXYGEN_S,
    RECEPTORS_S,
    local_law,
    local_settings,
    venous_content,
)
from eclsim.units import ML_S_PER_L_MIN

LEAST_ML = 1.0
"""Smallest blood volume of a compartment in the gas transport [mL]."""
SETTLED_ML_DL = (0.03, 0.05)
"""A compartment of the patient has settled within these contents of oxygen and of carbon dioxide [mL/dL]:
0.2 % of saturation at 10 g/dL of haemoglobin, and 0.1 mmHg."""
NOT_FOLLOWED = (
    "the gases of the blood could not be followed beat by beat; steady beats alone (--steady-only) may "
    "still give them"
)


class Gases(NamedTuple):
    """Gases at the end of a beat.

    Attributes:
        contents: oxygen and carbon dioxide contents of all compartments [mL/dL], (2, compartments).
        haemoglobin: haemoglobin concentration of these contents [g/dL].
        state: all gas quantities.
        sensed: lagged values that receptors and organs respond to, by name.
    """

    contents: np.ndarray
    haemoglobin: float
    state: Mapping[Quantity, float]
    sensed: Mapping[str, float]


class GasDynamics:
    """Gases of one circuit, beat by beat.

    Args:
        circuit: circuit with gas exchange.
        signals: recorded signals of a beat, including all flows.
        values: parameters of the circuit; NaN for those that depend on the gases.
    """

    def __init__(self, circuit: Circuit, signals: Sequence[str], values: Mapping[str, float]):
        self.circuit, self.steady, self.step = circuit, gas_of(circuit), gas_of(circuit, in_time=True)
        self.signals, self.lungs = signals, [lung.at for lung in lungs_of(circuit)]
        slow = (LUNG_RESISTANCE,)
        self.answers = tuple(n for n in solved_for(circuit) if n not in slow and np.isnan(values[n]))
        self.of_patient = [c.group == PATIENT for c in circuit.compartments]
        self.beside = np.array(total_volumes(circuit, values, [0.0] * len(circuit.compartments)))

    def begin(self, series: np.ndarray, phases: np.ndarray, values: Mapping[str, float]) -> Gases:
        """Return the gases of a steady beat.

        Args:
            series: signals of the beat, shape (points, signals).
            phases: phases of the points, from 0 to 1.
            values: parameters of the beat.
        """
        state = self._state(self.steady, [*self._flows(series, phases), *self._numbers(self.steady, values)])
        return Gases(self._contents(state), values[HAEMOGLOBIN], state, self._signals(state))

    def after(
        self,
        gases: Gases,
        series: np.ndarray,
        phases: np.ndarray,
        values: Mapping[str, float],
        volumes: tuple[np.ndarray, np.ndarray],
        period: float,
    ) -> Gases:
        """Return the gases one beat later.

        Args:
            gases: gases before the beat.
            series: signals of the beat, shape (points, signals).
            phases: phases of the points, from 0 to 1.
            values: parameters of the beat.
            volumes: stressed volumes of all compartments at the beginning and end of the beat [mL].
            period: duration of the beat [s].
        """
        blood = np.maximum(self.beside + np.stack(volumes), LEAST_ML) / period / ML_S_PER_L_MIN
        contents = gases.contents * [[values[HAEMOGLOBIN] / gases.haemoglobin], [1.0]]
        numbers = [*self._flows(series, phases), *self._numbers(self.step, values), *blood, *contents]
        held = values[LUNG_VOLUME] / period / ML_S_PER_L_MIN
        for lung in self.lungs:
            alveolar = [gases.state[Quantity(gas, "within", lung)] for gas in ("PO2", "PCO2")]
            numbers.append(np.array([held, *alveolar]))
        state = self._state(self.step, numbers)
        now, lags = self._signals(state), self._lags()
        sensed = {k: v - np.expm1(-period / lags[k]) * (now[k] - v) for k, v in gases.sensed.items()}
        return Gases(self._contents(state), values[HAEMOGLOBIN], state, sensed)

    def in_effect(self, gases: Gases, values: Mapping[str, float]) -> dict[str, float]:
        """Parameters that are set by the sensed gases."""
        sensed = gases.sensed
        effective = {name: sensed[name] for name in (SENSED_PAO2, SENSED_PACO2) if name in sensed}
        for bed in self._beds():
            settings = [values[name] for name in local_settings(bed)]
            # Content and supply of oxygen represent the content of the blood that leaves.
            numbers = [sensed[f"{bed}.oxygen"], 1.0, 0.0, sensed[f"{bed}.carbon_dioxide"], *settings]
            effective[local_resistance(bed)] = float(single(local_law, None)(np.array(numbers))[0])
        return {name: effective[name] for name in self.answers if name in effective}

    def distance(self, now: Gases, goal: Gases) -> float:
        """Largest difference of contents in the patient, relative to `SETTLED_ML_DL`."""
        share = np.abs(now.contents - goal.contents) / np.array(SETTLED_ML_DL)[:, None]
        return float(share[:, self.of_patient].max())

    def alveolar_mmhg(self, gases: Gases) -> np.ndarray:
        """PO2 of the gas in each lung [mmHg]."""
        return np.array([gases.state[Quantity("PO2", "within", lung)] for lung in self.lungs])

    def reason_without_gases(self, gases: Gases) -> str:
        """Reason why there are no gases; empty if there are."""
        return "" if np.isfinite(gases.contents).all() else NOT_FOLLOWED

    def _beds(self) -> list[str]:
        return [bed for bed in LOCAL_OUTPUTS if local_resistance(bed) in self.answers]

    def _signals(self, state: Mapping[Quantity, float]) -> dict[str, float]:
        """Gas values to which receptors and organs are exposed."""
        artery = artery_of(self.circuit)
        signals = {}
        if SENSED_PAO2 in self.answers:
            signals[SENSED_PAO2] = state[Quantity("PO2", "in", artery)]
            signals[SENSED_PACO2] = state[Quantity("PCO2", "in", artery)]
        for bed in self._beds():
            arterial = state[Quantity("oxygen", "mixed", bed)]
            supplied, gained = (state[Quantity(what, "at", bed)] for what in ("supplied", "gained"))
            signals[f"{bed}.oxygen"] = float(np.asarray(venous_content(arterial, supplied, gained)))
            signals[f"{bed}.carbon_dioxide"] = state[Quantity("PCO2", "in", bed)]
        return signals

    def _lags(self) -> dict[str, float]:
        """Time constant of each signal [s]."""
        organs = {"oxygen": ORGANS_OXYGEN_S, "carbon_dioxide": ORGANS_CARBON_DIOXIDE_S}
        of_organs = {f"{bed}.{gas}": lag for bed in self._beds() for gas, lag in organs.items()}
        return {SENSED_PAO2: RECEPTORS_S, SENSED_PACO2: RECEPTORS_S, **of_organs}

    def _flows(self, series: np.ndarray, phases: np.ndarray) -> np.ndarray:
        """Mean forward and backward flow of each connection [L/min]."""
        beat = Measures(dict(zip(self.signals, series.T, strict=True)), phases)
        return np.array([[mean(n) for n in self.step.connections] for mean in (beat.forward, beat.backward)])

    def _numbers(self, function: GasFunction, values: Mapping[str, float]) -> list[np.ndarray]:
        return [np.array([values[name] for name in function.parameters])]

    def _state(self, function: GasFunction, numbers: Sequence[np.ndarray]) -> dict[Quantity, float]:
        result = np.asarray(single(function.compute, function.key)(np.concatenate(numbers)))
        return dict(zip(function.quantities, result.tolist(), strict=True))

    def _contents(self, state: Mapping[Quantity, float]) -> np.ndarray:
        names = [c.name for c in self.circuit.compartments]
        return np.array([[state[Quantity(what, "mixed", name)] for name in names] for what in CONTENTS])
