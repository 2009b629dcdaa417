"""Measured steady beats of one or many patients: the only way from a batch to numbers.

Results that did not converge are NaN throughout; their status and message give the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from eclsim.arguments import WholeNumber, article
from eclsim.beat.grid import FINEST
from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import all_signals
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.components.base import Values
from eclsim.components.exchangers import TEMPERATURE, Tissue
from eclsim.devices.description import CAUTION, GASES
from eclsim.devices.registry import assist_connections, cached_by_devices, namings
from eclsim.gas.network import STATUS, GasStatus, gas_of
from eclsim.inputs.mistakes import as_settings
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution, in_threads
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.model import UnknownValueError
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, SolvedOrbits, solve
from eclsim.outputs.alarms import Finding, collapsed, findings, gravest_first
from eclsim.outputs.coupling import (
    CoupledAnchor,
    open_parameters,
    settle,
    solved_for,
    total_derivatives,
    with_resting_values,
)
from eclsim.outputs.derivatives import Linearisation, linearise
from eclsim.outputs.gas import PlaceGases, gases_of_places
from eclsim.outputs.measures import Measures, in_two_columns, whole_beat
from eclsim.outputs.ranges import impossible_contents, reasons_of_contents
from eclsim.outputs.registry import computed, is_users_output, leading_outputs, output
from eclsim.outputs.regulation import SOLVED_BY
from eclsim.outputs.sealed import Sealed, TrappedBlood, closed_valves, sealed, valve_flows
from eclsim.outputs.signals import (
    gas_dependent_outputs,
    needed_parameters,
    needed_signals,
    output_names,
    refuse_missing,
    watched_waveforms,
)

_TISSUE = Tissue()
_READ_BY_TISSUE = (GASES, str(_TISSUE.rise), TEMPERATURE)
NO_GASES: Mapping[int, PlaceGases] = MappingProxyType({})
_WITHOUT_LACTATE = ("pHa", "PaCO2", "PaCO2_lower", "PpreCO2", "PpostCO2")
_NO_LACTATE = (
    "no acid is made where oxygen is lacking, whereas a patient's lactate rises within minutes: pH and "
    "carbon dioxide are better than a patient's; do not read them"
)
DEMAND_MET = 0.99
"""Share of the oxygen demand below which consumption is reported as limited."""
NO_EJECTION_L_MIN = 0.02
"""Native output below which the heart counts as not ejecting."""


class Waveforms(NamedTuple):
    """A whole beat of one member: grid points from 0 to 1, and values (points, signals)."""

    phases: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class SteadyBeat:
    """Steady beats of a batch, with members as last dimension; NaN if a member did not converge.

    Args:
        orbits: states, and how each was solved.
        status: how the search of each member ended, a `Status`, shape (members,).
        native_l_min: native output of the last beat, shape (members,).
        undetermined: by member whose beat is one of many, the parts that closed valves isolate.
        names: names of the outputs.
        values: values of the outputs, shape (outputs, members).
        signals: names of the waveforms (P, Q, V and where; mmHg, mL/s, stressed mL).
        statistics: mean, smallest and largest value of each waveform, shape (3, signals, members).
        waveforms: whole beats of the members that were kept.
        gas_status: how the search for the steady gas state ended, a `GasStatus`, shape (members,); zeros if
            gases are not computed.
        gases: gases of the members that were kept and have a steady gas state.
        coupled: parameters that were solved for with the gases (`eclsim.outputs.coupling`).
        unsettled: whether these were not found for a member, shape (members,); None if there are none to
            solve for.
        response: inverse Jacobian for these parameters, see `CoupledAnchor`; None if there are none.
        trapped: blood behind closed valves by member, where earlier beats of the patient determine it.
    """

    orbits: SolvedOrbits
    status: np.ndarray
    native_l_min: np.ndarray
    undetermined: Mapping[int, Sealed]
    names: tuple[str, ...]
    values: np.ndarray
    signals: tuple[str, ...]
    statistics: np.ndarray
    waveforms: Mapping[int, Waveforms]
    gas_status: np.ndarray
    gases: Mapping[int, PlaceGases]
    coupled: tuple[str, ...] = ()
    unsettled: np.ndarray | None = None
    response: np.ndarray | None = None
    trapped: Mapping[int, TrappedBlood] = field(default_factory=dict)

    def __repr__(self) -> str:
        count = len(self.status)
        return f"<SteadyBeat of {count}, {int(self.converged.sum())} converged: {', '.join(self.names)}>"

    @property
    def batch(self) -> Batch:
        """The batch of the members."""
        return self.orbits.batch

    @property
    def converged(self) -> np.ndarray:
        """Whether a steady beat was found, even one of many, shape (members,)."""
        return (self.status == Status.CONVERGED) | (self.status == Status.ONE_OF_MANY)

    @property
    def determined(self) -> np.ndarray:
        """Whether a unique steady beat was found for each member, shape (members,)."""
        return self.status == Status.CONVERGED

    @property
    def without_gases(self) -> np.ndarray:
        """Members with a steady beat but no steady gas state, shape (members,)."""
        return self.determined & (self.gas_status != GasStatus.STEADY)

    @property
    def collapsed(self) -> np.ndarray:
        """Members whose beat no patient can have, shape (members,), judged from the measured waveforms."""
        return collapsed(self.signals, self.statistics[1])

    @property
    def of_gases(self) -> tuple[str, ...]:
        """Names of the outputs that depend on gas exchange."""
        return gas_dependent_outputs(self.batch.circuit, self.names)

    def output(self, name: str) -> np.ndarray:
        """An output of every member, shape (members,)."""
        return self.values[self.names.index(name)]

    def outputs(self, member: int = 0) -> dict[str, float]:
        """All outputs of a member by name."""
        return dict(zip(self.names, self.values[:, member].tolist(), strict=True))

    def mean(self, signal: str) -> np.ndarray:
        """Mean of a waveform over the beat, shape (members,); for a valve's flow, from the volume moved."""
        return self.statistics[0, self.signals.index(signal)]

    def lowest(self, signal: str) -> np.ndarray:
        """Smallest value of a waveform, shape (members,)."""
        return self.statistics[1, self.signals.index(signal)]

    def highest(self, signal: str) -> np.ndarray:
        """Largest value of a waveform, shape (members,)."""
        return self.statistics[2, self.signals.index(signal)]

    def waveform(self, signal: str, member: int = 0) -> np.ndarray:
        """A waveform of a member that was kept, shape (points,)."""
        return self.waveforms[member].values[:, self.signals.index(signal)]

    def volume(self, group: str) -> np.ndarray:
        """Stressed volume of a group of compartments at phase 0 [mL], shape (members,)."""
        members = [c.group == group for c in self.batch.circuit.compartments]
        volumes = self.orbits.states[assemble(self.batch.circuit).layout.volumes.where][members]
        return np.where(self.converged, volumes.sum(axis=0), np.nan)

    def values_in_effect(self, member: int = 0) -> Values:
        """Parameters of a member during its beat, with the values set by controllers."""
        return assemble(self.batch.circuit).in_effect(
            self.batch.member(member), self.orbits.states[:, member]
        )

    def message(self, member: int = 0) -> str:
        """Explanation of how the search ended, with the numbers behind it and advice."""
        status = Status(int(self.status[member]))
        text = status.message
        if self.unsettled is not None and self.unsettled[member]:
            gases = GasStatus(int(self.gas_status[member]))
            steady = gases is GasStatus.STEADY
            reason = "gases and circulation do not settle" if steady else self._gas_message(member)
            return f"no steady beat found in which regulation and blood gases agree: {reason}"
        if status is Status.INVALID_INPUT:
            mistakes = allowed_values(self.batch.circuit).reasons(self.batch.member(member))
            return f"{text}: {'; '.join(mistakes)}"
        if status is Status.ONE_OF_MANY:
            text = f"{text}: {self.undetermined[member].reason}"
        elif status is Status.CONVERGED and self.gas_status[member]:
            text = f"{text}, but {self._gas_message(member)}"
        elif status is not Status.CONVERGED:
            residual, drift = self.orbits.residual[member], self.orbits.drift[member]
            native = f"native output {self.native_l_min[member]:.3g} L/min, "
            text += f" ({native if status is Status.NO_EJECTION else ''}residual {residual:.1e}, "
            text += f"drift {drift:.2g} mL a beat)"
        doubt = self.orbits.grid_warning(member)
        return f"{text}; {doubt}" if doubt else text

    def _gas_message(self, member: int) -> str:
        status, batch = GasStatus(int(self.gas_status[member])), self.batch
        if status is not GasStatus.INVALID_INPUT:
            return status.message
        reasons = reasons_of_contents(batch.circuit, batch.all_values_of(member))
        return f"{status.message}: {'; '.join(reasons)}"

    def determined_only(self) -> SteadyBeat:
        """Return the same beats with NaN where a beat is one of many."""
        lost = ~self.determined
        states = np.where(lost, np.nan, self.orbits.states)
        return replace(self._without(lost), orbits=replace(self.orbits, states=states))

    def _without(self, failed: np.ndarray) -> SteadyBeat:
        waves = {
            k: w._replace(values=w.values * np.nan) if failed[k] else w for k, w in self.waveforms.items()
        }
        gases = {k: result for k, result in self.gases.items() if not failed[k]}
        values, statistics = (np.where(failed, np.nan, table) for table in (self.values, self.statistics))
        return replace(self, values=values, statistics=statistics, waveforms=waves, gases=gases)

    def findings(self, member: int = 0) -> list[Finding]:
        """Limits that a member's beat violates and cautions about its numbers, sorted by severity."""
        result: list[Finding] = []
        if self.converged[member]:
            extremes = self.statistics[1:, :, member].T.tolist()
            values = self.batch.all_values_of(member)
            circuit = self.batch.circuit.with_chosen_sites(values)
            ranges = {name: (low, high) for name, (low, high) in zip(self.signals, extremes, strict=True)}
            known = self.trapped.get(member)
            result = findings(self.outputs(member), ranges, circuit, values, known)
            result += self._gas_findings(member)
            result = [self._if_determined(one, member) for one in result]
        if doubt := self.orbits.grid_warning(member):
            result.append(Finding.without_limit("warning", "grid", np.nan, doubt))
        return gravest_first(result)

    def undetermined_outputs(self, member: int = 0) -> tuple[str, ...]:
        """Outputs that the case does not determine, as the member's beat is one of many; usually none."""
        concerned = self.undetermined[member].concerns if member in self.undetermined else ()
        return tuple(name for name in concerned if name in self.names)

    def determined_findings(self, member: int = 0) -> list[Finding]:
        """Findings of a member without limits that only undetermined outputs and waveforms violate."""
        return [one for one in self.findings(member) if not self._is_undetermined(one, member)]

    def _is_undetermined(self, finding: Finding, member: int) -> bool:
        """Whether a finding compares a number that the case does not determine with a limit."""
        if member not in self.undetermined or finding.kind == CAUTION:
            return False
        return finding.quantity in {*self.undetermined_outputs(member), *self.signals}

    def _if_determined(self, finding: Finding, member: int) -> Finding:
        """A finding, which says so if it is about a number that the case does not determine."""
        if not self._is_undetermined(finding, member):
            return finding
        return replace(finding, sentence=f"{finding.sentence}; the case does not determine this number")

    def _gas_findings(self, member: int) -> list[Finding]:
        """Findings about gases, other than limits."""
        read, status = self.of_gases, GasStatus(int(self.gas_status[member]))
        if status is not GasStatus.STEADY:
            return [Finding.without_limit("alarm", "VO2", np.nan, self._gas_message(member), *read)]
        if "VO2" not in read:
            return []
        vo2 = float(self.output("VO2")[member])
        demand = float(_TISSUE.oxygen_demand(self.batch.numbers_for(_READ_BY_TISSUE, member)))
        if vo2 > DEMAND_MET * demand:
            return []
        text = f"oxygen consumption {vo2:.0f} mL/min is below the {demand:.0f} mL/min that the tissues need: "
        text += "the supply limits it"
        result = [Finding("alarm", "VO2", vo2, demand, text, concerns=("VO2",))]
        if of_acid := [name for name in _WITHOUT_LACTATE if name in self.names]:
            value = float(self.output(of_acid[0])[member])
            result.append(Finding.without_limit(CAUTION, of_acid[0], value, _NO_LACTATE, *of_acid))
        return result

    def linearise(self, outputs: Sequence[str], parameters: Sequence[str], member: int = 0) -> Linearisation:
        """First-order expansion of a member's outputs in parameters of the circuit or `heart_rate_bpm`.

        Raises:
            NoDerivativesError: The member has no steady beat, or its equation is singular.
            UnknownValueError: A parameter is itself solved for with the beat.
        """
        if solved := [name for name in parameters if name in self.coupled]:
            raise UnknownValueError(f"{solved[0]} is solved with the beat: give it a value to hold it")
        if not self.converged[member]:
            raise NoDerivativesError(Status(int(self.status[member])), self.message(member))
        gases = GasStatus(int(self.gas_status[member]))
        if gases is not GasStatus.STEADY and gas_dependent_outputs(self.batch.circuit, outputs):
            raise NoDerivativesError(
                Status(int(self.status[member])), self._gas_message(member), gases=gases.word
            )
        read = (*outputs, *(SOLVED_BY[name] for name in self.coupled))
        names = (*parameters, *self.coupled)
        program = beat_program(self.batch.circuit, int(self.orbits.resolution[member]))
        problem = OrbitProblem(program, self.batch.packed(program), self.batch.volume()).take([member])
        slopes = self.batch.volume_slopes(names, member)
        values = self.batch.numbers_for(needed_parameters(self.batch.circuit, read), member)
        state, circuit = self.orbits.states[:, member], self.batch.circuit
        linear = linearise(problem, state, read, names, slopes, values, circuit)
        return total_derivatives(linear, len(outputs), len(parameters)) if self.coupled else linear


def steady_beat(
    batch: Batch,
    outputs: Sequence[str] | None = None,
    *,
    waveforms: Sequence[str] | None = (),
    keep: Sequence[int] | None = (),
    options: OrbitOptions | None = None,
    start: Mapping[str, float] | Anchor | None = None,
    resolution: int | None = None,
    execution: Execution | None = None,
) -> SteadyBeat:
    """Solve and measure the steady beats of a batch.

    Args:
        batch: the members.
        outputs: names of outputs, as in the registry; None for all that the circuit has.
        waveforms: waveforms whose mean, smallest and largest values are computed; None for all.
        keep: members whose whole waveforms are returned, too; None for all members.
        options: accuracy and effort of the search.
        start: start of the searches, see `eclsim.orbit.steady.solve`.
        resolution: resolution of the phase grid; None takes what each member's time constants need.
        execution: how the batch is computed.

    Raises:
        UnknownOutputError: The circuit has no such output.
    """
    if not isinstance(batch, Batch):
        allowed = "eclsim.Batch.of(model), or eclsim.Batch(...) of several"
        raise TypeError(f"{article(type(batch).__name__)} is not a batch of patients; allowed: {allowed}")
    refuse_missing(outputs or (), batch.circuit)
    options = as_settings(options, OrbitOptions, "options")
    execution = as_settings(execution, Execution, "execution")
    resolution = None if resolution is None else WholeNumber(1, FINEST)("resolution", resolution)
    # A part of the batch uses the same program as the whole.
    execution = replace(execution, width=execution.width_for(batch.count))
    threads = execution.thread_count()
    keep = range(batch.count) if keep is None else keep
    first = with_resting_values(start) if solved_for(batch.circuit) else start

    def orbits_of(part: Batch, begin: Mapping[str, float] | Anchor | None) -> SolvedOrbits:
        return solve(part, options, start=begin, resolution=resolution, execution=execution)

    names = open_parameters(batch)
    if not names:
        return measured(orbits_of(batch, first), outputs, waveforms, keep, threads)
    full = outputs is None or waveforms is None or bool(waveforms) or bool(keep)
    read = tuple(dict.fromkeys((*(SOLVED_BY[name] for name in names), *(() if full else outputs or ()))))

    def measure(part: Batch, begin: Mapping[str, float] | Anchor | None) -> SteadyBeat:
        return measured(orbits_of(part, begin), read, (), (), threads)

    coupled = settle(batch, names, measure, options, first)
    if isinstance(first, CoupledAnchor) and not coupled.settled.all():
        coupled = settle(batch, names, measure, options, Anchor(first.state, first.inverse))
    beat = None if full else coupled.beat
    beat = measured(coupled.orbits, outputs, waveforms, keep, threads) if beat is None else beat
    failed = beat.converged & ~coupled.settled
    beat.status[failed] = Status.NOT_CONVERGED
    return replace(beat, coupled=names, unsettled=failed, response=coupled.response)._without(failed)


def measured(
    orbits: SolvedOrbits,
    outputs: Sequence[str] | None,
    waveforms: Sequence[str] | None,
    keep: Sequence[int],
    threads: int = 1,
) -> SteadyBeat:
    """Compute, record and measure one more beat of every member."""
    circuit, count = orbits.batch.circuit, orbits.batch.count
    requested = output_names(circuit) if outputs is None else tuple(outputs)
    names = tuple(dict.fromkeys((*requested, *status_outputs(circuit))))
    signals = all_signals(assemble(circuit)) if waveforms is None else tuple(waveforms)
    values, statistics = np.full((len(names), count), np.nan), np.full((3, len(signals), count), np.nan)
    kept: dict[int, Waveforms] = {}
    gases: dict[int, PlaceGases] = {}
    with_gas, gas_status = bool(gas_dependent_outputs(circuit, names)), np.zeros(count, dtype=int)

    def measure(members: np.ndarray) -> None:
        recorded = needed_signals(circuit, names, signals)
        series, phases = _recorded(orbits, members, recorded)
        parameters = orbits.batch.read_by_outputs(needed_parameters(circuit, names), members)
        waves = {name: series[:, k] for k, name in enumerate(recorded)}
        measures = Measures(waves, phases, circuit, parameters, batch=count)
        measures.measure_means(recorded, series)
        measures.measure_extremes(recorded, series)
        if with_gas:
            measures.measure_one_way(gas_of(circuit).connections, recorded, series)
        for row, name in zip(values, names, strict=True):
            row[members] = computed(name, measures)[: len(members)]
        if with_gas:
            gas_status[members] = measures.gas(*STATUS)[: len(members)]
            steady = [k for k, m in enumerate(members.tolist()) if m in keep and not gas_status[m]]
            gases.update({int(members[k]): gases_of_places(measures, k) for k in steady})
        columns = series.take([recorded.index(signal) for signal in signals], axis=1)
        statistics[:, :, members] = statistics_of(measures, signals, columns)[..., : len(members)]
        kept.update(
            {m: Waveforms(phases, columns[..., k]) for k, m in enumerate(members.tolist()) if m in keep}
        )

    in_threads(measure, _blocks(orbits), threads)
    outcome = dict(zip(names, values, strict=True))
    if with_gas and (wrong := impossible_contents(orbits.batch)).any():
        gas_status[wrong] = GasStatus.INVALID_INPUT
        for name in gas_dependent_outputs(circuit, names):
            outcome[name][wrong] = np.nan
        gases = {k: found for k, found in gases.items() if not wrong[k]}
    return with_status(orbits, requested, outcome, signals, statistics, kept, gas_status, gases)


def _blocks(orbits: SolvedOrbits) -> list[np.ndarray]:
    """Groups of members that are recorded together: with the same grid, up to `SIDE_BY_SIDE`."""
    blocks = []
    for level in np.unique(orbits.resolution):
        members = np.flatnonzero(orbits.resolution == level)
        blocks += [members[k : k + SIDE_BY_SIDE] for k in range(0, len(members), SIDE_BY_SIDE)]
    return blocks


def _recorded(
    orbits: SolvedOrbits, members: np.ndarray, signals: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Signals of members' beats (points, signals, members), and phases.

    A single member is computed in two columns.
    """
    search = orbits.search(int(members[0]))
    packed = orbits.batch.packed(search.program)[:, members]
    states = orbits.states[:, members]
    several = search.width > 1
    recorded = _usual_signals(orbits.batch.circuit, signals) if several else signals
    recorded, series = search.record(states, packed, recorded)
    series = whole_beat(series.take([recorded.index(name) for name in signals], axis=1))
    if len(members) == 1:
        series = in_two_columns(series)
    return series, search.program.grid.phases


@cached_by_devices(256)
def _usual_signals(circuit: Circuit, signals: tuple[str, ...]) -> tuple[str, ...]:
    """The smallest usual set of signals that contains the given ones; the given ones if none does.

    Beats side by side are compiled for each set (some 5 s). With few sets the program of one question about a
    circuit serves the next.
    """
    names, watched = output_names(circuit), watched_waveforms(circuit)
    first = [*(entry.name for entry in leading_outputs() if entry.name in names), *status_outputs(circuit)]
    lists = first, [*first, *gas_dependent_outputs(circuit, names)], names
    usual = [needed_signals(circuit, tuple(one), watched) for one in lists]
    return next((one for one in usual if set(signals) <= set(one)), signals)


@cached_by_devices(256)
def _of_the_beat_alone(names: tuple[str, ...]) -> tuple[str, ...]:
    """Outputs that are finite in every beat that was found; those of a user's device need not be."""
    return tuple(name for name in names if not (output(name).parameters or is_users_output(name)))


def with_status(
    orbits: SolvedOrbits,
    names: tuple[str, ...],
    outputs: Mapping[str, np.ndarray],
    signals: tuple[str, ...],
    statistics: np.ndarray,
    waveforms: Mapping[int, Waveforms],
    gas_status: np.ndarray,
    gases: Mapping[int, PlaceGases] = NO_GASES,
) -> SteadyBeat:
    """Determine the status of each measured member and remove the numbers of those not converged.

    Args:
        orbits: solved orbits.
        names: names of the requested outputs.
        outputs: outputs by name, shape (members,), including those of `status_outputs`.
        signals: names of the waveforms.
        statistics: statistics of the waveforms, see `SteadyBeat`.
        waveforms: waveforms of the members that are kept.
        gas_status: how the search for the steady gas state of each member ended.
        gases: gases of the members that are kept.
    """
    status, circuit = np.array(orbits.status), orbits.batch.circuit
    native = _native_output(outputs, circuit, orbits.batch.count)
    status[(status == Status.NOT_CONVERGED) & (native < NO_EJECTION_L_MIN)] = Status.NO_EJECTION
    beats = [outputs[name] for name in _of_the_beat_alone(tuple(outputs))]
    finite = np.isfinite(beats).all(axis=0) if beats else True
    status[(status != Status.INVALID_INPUT) & ~(finite & np.isfinite(statistics).all(axis=(0, 1)))] = (
        Status.NOT_FINITE
    )
    undetermined = {}
    for member in map(int, np.flatnonzero(status == Status.CONVERGED)):
        flows = {name: float(outputs[name][member]) for name in valve_flows(circuit)}
        if closed_valves(flows):
            own = orbits.batch.member(member)
            result = sealed({**dict.fromkeys(names, np.nan), **flows}, circuit.with_chosen_sites(own), own)
            if result is not None:
                undetermined[member], status[member] = result, Status.ONE_OF_MANY
    values = np.array([outputs[name] for name in names]).reshape(len(names), orbits.batch.count)
    beat = SteadyBeat(
        orbits, status, native, undetermined, names, values, signals, statistics, waveforms, gas_status, gases
    )
    return beat._without(~beat.converged)


def statistics_of(measures: Measures, signals: Sequence[str], waves: np.ndarray) -> np.ndarray:
    """Mean, smallest and largest value of waveforms (points, signals, members): (3, signals, members)."""
    if not signals:
        return np.empty((3, 0, 1))
    return np.stack([[measures.mean(n) for n in signals], waves.min(axis=0), waves.max(axis=0)])


def _native_output(outputs: Mapping[str, np.ndarray], circuit: Circuit, count: int) -> np.ndarray:
    """Larger of the outputs of the left heart, with its assist devices, and the right heart [L/min].

    Infinite for a circuit without an aortic valve, where the output is unknown.
    """
    left, right = np.full(count, np.inf), outputs.get("CO")
    if "aortic_valve_flow" in outputs:
        left = np.sum([outputs[name] for name in left_outputs(circuit)], axis=0)
    return left if right is None else np.maximum(left, right)


@cached_by_devices(256)
def left_outputs(circuit: Circuit) -> tuple[str, ...]:
    """Outputs that together are the output of the left heart and its assist devices."""
    pumps = assist_connections(circuit)
    groups = dict.fromkeys(c.group for c in circuit.connections if c.name in pumps)
    assists = (names.output(names.device.assist_flow) for names in namings(groups))
    known = output_names(circuit)
    return tuple(name for name in ("aortic_valve_flow", *assists) if name in known)


@cached_by_devices(256)
def status_outputs(circuit: Circuit) -> tuple[str, ...]:
    """Outputs that show whether the heart ejects and which valves carry blood."""
    known = output_names(circuit)
    names = (*valve_flows(circuit), *left_outputs(circuit), "CO")
    return tuple(name for name in dict.fromkeys(names) if name in known)
