"""All schemes at all speeds as one batch: the circuit with switched CRRT lines, and its solved beats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.beat.resolution import needed_resolution
from eclsim.cases.resolve import resolve_parameters
from eclsim.circuit import Choice, Circuit
from eclsim.circuit.assembly import assemble
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import POSITIONS
from eclsim.orbit.model import PATIENT_HELD, circuit_of
from eclsim.orbit.steady import Batch, steady_beats
from eclsim.outputs.records import BeatRecords, record

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.crrt_study.schemes import Scheme

ACCESS, RETURN, SPEED = "crrt.access_site", "crrt.return_site", "ecmo.speed_rpm"
START_PRESSURE, VENOUS_COMPLIANCE = "P0svn", "Csvn"


@dataclass(frozen=True)
class Bench:
    """A patient on ECMO with the CRRT circuit's lines on switches, and the same patient without CRRT.

    Args:
        circuit: with CRRT; `crrt.access_site` and `crrt.return_site` choose among `nodes`.
        without: the same without CRRT.
        values: the case's parameters, CRRT flow included.
        nodes: compartments that a line may attach to.
        schemes: the schemes of the study.
    """

    circuit: Circuit
    without: Circuit
    values: dict[str, float]
    nodes: tuple[str, ...]
    schemes: tuple[Scheme, ...]

    def run(
        self,
        speeds: np.ndarray,
        policy: str,
        keep: Sequence[int] = (),
        patient_volume_ml: float | None = None,
    ) -> BeatRecords:
        """Steady beats of all schemes at all speeds, schemes slowest.

        Args:
            speeds: pump speeds [rpm].
            policy: blood volume policy.
            keep: members whose waveforms are kept.
            patient_volume_ml: stressed volume of the patient, with `patient_held`; left out, the case's own.
        """
        values = self._values(patient_volume_ml)
        places = self._places()
        near = values | {ACCESS: places[0, 0], RETURN: places[0, 1]}
        members = values | {
            ACCESS: np.repeat(places[:, 0], len(speeds)),
            RETURN: np.repeat(places[:, 1], len(speeds)),
            SPEED: np.tile(speeds, len(self.schemes)),
        }
        batch = Batch(self.circuit, members, len(self.schemes) * len(speeds), policy)
        return record(steady_beats(batch, near=near), keep)

    def run_patients(
        self, speeds: np.ndarray, policy: str, patients: Mapping[str, np.ndarray]
    ) -> BeatRecords:
        """Steady beats of variants of the patient: schemes slowest, then speeds, then patients.

        Args:
            speeds: pump speeds [rpm].
            policy: blood volume policy.
            patients: parameters that differ, each of shape (patients,).
        """
        count = len(next(iter(patients.values())))
        places = self._places()
        per_scheme = len(speeds) * count
        members = self.values | {
            ACCESS: np.repeat(places[:, 0], per_scheme),
            RETURN: np.repeat(places[:, 1], per_scheme),
            SPEED: np.tile(np.repeat(speeds, count), len(places)),
        }
        members |= {name: np.tile(values, len(places) * len(speeds)) for name, values in patients.items()}
        near = self.values | {ACCESS: places[0, 0], RETURN: places[0, 1]}
        batch = Batch(self.circuit, members, len(places) * per_scheme, policy)
        return record(steady_beats(batch, near=near, resolution=_resolution(self.circuit, members)))

    def _places(self) -> np.ndarray:
        """Positions in `nodes` of access and return, shape (schemes, 2)."""
        return np.array([[self.nodes.index(node) for node in s.nodes] for s in self.schemes], dtype=float)

    def run_without(self, speeds: np.ndarray, policy: str) -> BeatRecords:
        """Steady beats of the patient on ECMO alone."""
        batch = Batch(self.without, self.values | {SPEED: speeds}, len(speeds), policy)
        return record(steady_beats(batch, near=self.values), range(len(speeds)))

    def _values(self, patient_volume_ml: float | None) -> dict[str, float]:
        """Parameters with the systemic veins filled so that the patient starts with a given volume."""
        if patient_volume_ml is None:
            return self.values
        batch = Batch(self.without, self.values, 1, PATIENT_HELD)
        missing = patient_volume_ml - float(batch.volume().target[0])
        start = self.values[START_PRESSURE] + missing / self.values[VENOUS_COMPLIANCE]
        return self.values | {START_PRESSURE: start}


def _resolution(circuit: Circuit, members: Mapping[str, Any]) -> int:
    """One grid for all members: the finest that any of them needs."""
    return int(np.max(needed_resolution(assemble(circuit), members)))


def bench_of(case: Case, schemes: Sequence[Scheme], crrt_flow_ml_min: float) -> Bench:
    """The bench of a case with ECMO; its own CRRT section, if any, gives way to the schemes."""
    alone = case.model_copy(update={"crrt": None})
    without = circuit_of(alone)
    others = dict.fromkeys(node for s in schemes for node in s.nodes if node not in POSITIONS.values())
    nodes = (*POSITIONS.values(), *sorted(others))
    circuit = without + crrt(Choice(nodes, ACCESS), Choice(nodes, RETURN))
    values = resolve_parameters(alone) | {"crrt.flow_ml_min": crrt_flow_ml_min}
    return Bench(circuit, without, values, nodes, tuple(schemes))
