"""Inputs of a sensitivity analysis: numbers within bounds and choices, around the values of a case.

By default these are the paper's 24 cardiovascular parameters. Further inputs are settings of the devices,
manufacturers' sizes of cannulae, and the sites or the scheme of a CRRT. This module also has the
uncertainties of the clinical measurements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eclsim.cases.resolve import circuit_of, switched_circuit
from eclsim.circuit.network import Choice, Circuit
from eclsim.devices.dialysed_blood import follows_blood_hint
from eclsim.devices.registry import SCHEME, devices, parameter_of, parameters
from eclsim.inputs.mistakes import InputError
from eclsim.inputs.named_values import named_texts
from eclsim.outputs.registry import unavailable
from eclsim.outputs.results import unit_of_value
from eclsim.outputs.signals import parameters_read
from eclsim.outputs.uncertainty import DEFAULTS, Uncertainty, as_uncertainties
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.devices.device import Instance

CARDIOVASCULAR = (
    "Rao", "Rsart", "Rmc", "Rsvn", "Rpas", "Rpart", "Rpmc", "Rpvn",
    "Cao", "Csart", "Csvn", "Cpas", "Cpart", "Cpvn", "Lao", "Lsart", "Lpas", "Lpart",
    "Edla", "Edra", "Emaxla", "Emaxlv", "Emaxra", "Emaxrv",
)  # fmt: skip
"""The parameters of the paper's global sensitivity analysis (Figure 3)."""

GROUPS = {"R": "resistance", "C": "compliance", "L": "inertance", "E": "elastance"}
"""Groups of parameters by letter, and the quantity that their units measure."""
MOST_LISTED = 60
OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")


RANGE_OF = "the range of "
"""Start of the warnings about the ranges themselves, which are not about the beat at the central values."""

Range = tuple[float, float] | tuple[float, float, Literal["log"]]
"""Lower and upper bound of an input, in its unit; with "log" its logarithm is uniform, else the number."""
Description = dict[str, Any]
"""Plain data that describe a design or a model, stored in its file and compared with others."""


@dataclass(frozen=True)
class Continuous:
    """A number, uniform between two bounds, or with a uniform logarithm.

    Args:
        name: parameter of the model.
        low: lower bound, in the parameter's unit.
        high: upper bound.
        log: whether the logarithm is uniform; the bounds are then above 0.
        own: whether the range was given for this input; else it is the common perturbation.
    """

    name: str
    low: float
    high: float
    log: bool = False
    own: bool = False

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameter for numbers in [0, 1), scaled as SALib does."""
        if self.log:
            return {self.name: np.clip(self.low * (self.high / self.low) ** unit, self.low, self.high)}
        return {self.name: unit * (self.high - self.low) + self.low}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """Values for a table of samples."""
        return self.settings(unit)[self.name]

    def description(self) -> Description:
        """Plain data that describe the input."""
        marks = {"log": self.log, "own": self.own}  # left out if false: descriptions of old folders stay
        bounds = {"name": self.name, "low": self.low, "high": self.high}
        return bounds | {name: True for name, marked in marks.items() if marked}


@dataclass(frozen=True)
class Categorical:
    """One of several equally likely choices, each of which sets one or several parameters.

    The choice is a function of the input's own coordinate in the design. Points of a row with the same
    coordinate therefore have the same choice, as the estimators require.

    Args:
        name: name of the input.
        levels: names of the choices.
        sets: each parameter with its values for the levels.
    """

    name: str
    levels: tuple[str, ...]
    sets: tuple[tuple[str, tuple[float, ...]], ...]

    def choose(self, unit: np.ndarray) -> np.ndarray:
        """Index of the chosen level for numbers in [0, 1)."""
        return np.minimum((unit * len(self.levels)).astype(int), len(self.levels) - 1)

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters that the choice sets."""
        chosen = self.choose(unit)
        return {parameter: np.asarray(values, dtype=float)[chosen] for parameter, values in self.sets}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """Names of the chosen levels."""
        return np.array(self.levels, dtype=object)[self.choose(unit)]

    def description(self) -> Description:
        """Plain data that describe the input."""
        return {"name": self.name, "levels": list(self.levels), "sets": {p: list(v) for p, v in self.sets}}


Input = Continuous | Categorical


def described_input(description: Description) -> Input:
    """Return the input with a given description."""
    if "levels" not in description:
        return Continuous(**description)
    sets = tuple((name, tuple(values)) for name, values in description["sets"].items())
    return Categorical(description["name"], tuple(description["levels"]), sets)


@dataclass(frozen=True)
class VariedInputs:
    """Inputs of an analysis, and the model that they are varied around.

    Args:
        circuit: circuit of the case, with choices where sites are inputs.
        base: value of every parameter.
        inputs: varied inputs.
        groups: factor of each input; empty if each is its own factor.
        warnings: ranges that are cut at a bound, or do not contain the value of the case.
    """

    circuit: Circuit
    base: Mapping[str, float]
    inputs: tuple[Input, ...]
    groups: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def varied_inputs(
    case: Case,
    base: Mapping[str, float],
    parameters: Sequence[str] = CARDIOVASCULAR,
    include: Sequence[str] = (),
    groups: Sequence[str] = (),
    perturbation_percent: float = 25.0,
    ranges: Mapping[str, Range] | None = None,
) -> VariedInputs:
    """Build the inputs of an analysis around a case.

    Args:
        case: patient and devices.
        base: values of all parameters, around which the inputs vary.
        parameters: names of parameters, uniform within the perturbation.
        include: further inputs: parameters, device settings, `crrt.scheme`, `crrt.access_site`, ...
        groups: kinds (R, C, L, E, see `GROUPS`) whose parameters are one factor together.
        perturbation_percent: half width of the range of each number without a range of its own.
        ranges: own ranges of inputs, as `checked_ranges` returns them.
    """
    ranges = ranges or {}
    lines = _line_inputs(case)
    circuit, positions = _circuit(case, [name for name in include if name in lines])
    known = [*parameters_read(circuit), *lines]
    requested = [*parameters, *include]
    mistakes = unknown_names(requested, known, "parameter that this case reads") + _wrong_groups(
        groups, parameters
    )
    mistakes += _ranges_of_others(ranges, requested, known)
    if not 0.0 < perturbation_percent < 100.0:
        mistakes.append(f"perturbation {perturbation_percent:g} %: allowed: above 0 and below 100 %")
    for scheme in (name for name in include if lines.get(name)):
        if also := [name for name in lines[scheme] if name in include]:
            mistakes.append(f"{scheme}: already sets all lines; leave out {' and '.join(also)}, or {scheme}")
    if mistakes:
        raise InputError(mistakes)
    base = dict(base) | positions
    names = [*dict.fromkeys([*parameters, *include])]
    share = perturbation_percent / 100.0
    inputs = tuple(_make_input(name, case, circuit, base, share, ranges.get(name)) for name in names)
    _check_ranges(inputs, case)
    kinds = {n: letter_of(n) for n in parameters}
    labels = tuple(kinds[n] if kinds.get(n) in groups else n for n in names) if groups else ()
    return VariedInputs(circuit, base, inputs, labels, tuple(_range_warnings(inputs, base, share)))


def _line_inputs(case: Case) -> dict[str, tuple[str, ...]]:
    """Inputs that set positions of lines, such as `crrt.scheme`; for a scheme, the lines that it sets."""
    connected = [(instance.key, instance.device) for instance in case.instances()]
    absent = [(k, device) for k, device in devices().items() if device not in [d for _, d in connected]]
    result: dict[str, tuple[str, ...]] = {}
    for key, device in (*connected, *absent):
        lines = tuple(f"{key}.{line}" for line in device.lines)
        result |= {f"{key}.{SCHEME}": lines} if device.schemes else {}
        result |= dict.fromkeys(lines, ())
    return result


def _circuit(case: Case, moved: Sequence[str]) -> tuple[Circuit, dict[str, float]]:
    """Return the circuit, with switchable lines if any of these is an input, and their present positions."""
    if not moved:
        return circuit_of(case), {}
    circuit, positions = switched_circuit(case)
    wrong = []
    for name in moved:
        section, _, line = name.rpartition(".")
        lines = [name] if line != SCHEME else [key for key in positions if key.startswith(f"{section}.")]
        if not lines or not set(lines) <= set(positions):
            wrong.append(_cannot_be_moved(case, name))
    if wrong:
        raise InputError(wrong)
    return circuit, positions


def _cannot_be_moved(case: Case, name: str) -> str:
    """Explain why the lines of a device cannot be an input of this case."""
    section = name.rpartition(".")[0]
    instance = case.instance(section)
    sites = [site for other in case.instances() for site in other.sites()]
    if instance is None or not sites:
        others = [key for key, device in devices().items() if device.positions]
        return f"{name}: the case needs the sections {' and '.join(f'[{k}]' for k in (*others, section))}"
    at = ", ".join(str(getattr(instance.section, line)) for line in instance.device.lines)
    return f"{section} at {at}: to vary it, each line must be at one of {', '.join(sites)}"


def unknown_names(names: Sequence[str], known: Sequence[str], kind: str) -> list[str]:
    """One sentence for each unknown name, with the nearest spelling or, if few, the allowed names."""
    wrong = []
    for name in dict.fromkeys(names):
        if name not in known:
            allowed = f"; allowed: {', '.join(known)}" if len(known) <= MOST_LISTED else ""
            wrong.append(f"{name}: no {kind}{spelling_hint(name, known) or allowed}")
    return wrong


def missing_outputs(names: Sequence[str], available: Sequence[str]) -> list[str]:
    """One sentence for each output that a case lacks, with what it needs or the nearest spelling."""
    absent = [name for name in dict.fromkeys(names) if name not in available]
    return [f"{name}: no output of this case{unavailable(name, available)}" for name in absent]


def letter_of(name: str) -> str:
    """Letter of the group of a parameter, from the quantity of its unit; empty if it belongs to none."""
    parameter = parameter_of(name)
    measured = None if parameter is None else parameter.quantity
    return next((letter for letter, quantity in GROUPS.items() if quantity == measured), "")


def _wrong_groups(groups: Sequence[str], parameters: Sequence[str]) -> list[str]:
    kinds = {letter_of(p) for p in parameters}
    allowed = ", ".join(f"{k} ({v}s)" for k, v in GROUPS.items())
    wrong = [f"group {g}: allowed: {allowed}" for g in groups if g not in GROUPS]
    return wrong + [
        f"group {g}: none of the parameters varied is one of the {GROUPS[g]}s"
        for g in groups
        if g in GROUPS and g not in kinds
    ]


def _ranges_of_others(ranges: Mapping[str, Range], inputs: Sequence[str], known: Sequence[str]) -> list[str]:
    """One sentence for each range of a name that is unknown or not among the inputs."""
    wrong = unknown_names([name for name in ranges if name not in inputs], known, "parameter of this case")
    wrong = [f"range of {sentence}" for sentence in wrong]
    return wrong + [
        f"range of {name}: not among the inputs; add it to --parameters or --include"
        for name in ranges
        if name in known and name not in inputs
    ]


def _make_input(
    name: str, case: Case, circuit: Circuit, base: Mapping[str, float], share: float, own: Range | None
) -> Input:
    section, _, key = name.rpartition(".")
    device = case.instance(section)
    choices = {
        site.parameter: site
        for path in circuit.connections
        for site in (path.source, path.target)
        if isinstance(site, Choice)
    }
    if own is not None and (key == SCHEME or name in choices):
        raise InputError([f"range of {name}: it is a choice of positions, which has no range; leave it out"])
    if device is not None and key == SCHEME:
        return _schemes(name, device, case)
    if name in choices:
        sites = choices[name].sites  # labelled by the device whose positions they are
        labelled = (device.sites() for device in case.instances())
        labels = next((tuple(own) for own in labelled if tuple(own.values()) == sites), sites)
        return Categorical(name, labels, ((name, tuple(float(k) for k in range(len(labels)))),))
    sizes = device.device.sizes(device.section, key) if device is not None else ()
    if sizes:
        return _sizes_within(name, sizes, base[name], share, own)
    if own is not None:
        return Continuous(name, own[0], own[1], log=len(own) == 3, own=True)
    if (parameter := parameters().get(name)) is not None:
        return Continuous(name, *parameter.varied(base[name], share))
    low, high = sorted((base[name] * (1.0 - share), base[name] * (1.0 + share)))
    return Continuous(name, low, high)


def _schemes(name: str, device: Instance, case: Case) -> Categorical:
    """Return the usual connection schemes of a device as an input."""
    at = {getattr(device.section, line) for line in device.device.lines}
    (other,) = (o for o in case.instances() if at <= set(o.sites()))
    places = list(other.device.positions)
    settings = tuple(
        (
            f"{device.key}.{line}",
            tuple(float(places.index(way[line])) for way in device.device.schemes.values()),
        )
        for line in device.device.lines
    )
    return Categorical(name, tuple(device.device.schemes), settings)


def _sizes_within(
    name: str, sizes: Sequence[float], size: float, share: float, own: Range | None
) -> Categorical:
    """Return the manufacturer's sizes within the perturbation, or within an own range, as an input."""
    if own is not None and len(own) == 3:
        raise InputError([f"range of {name}: its sizes are equally likely; leave out log"])
    if own is not None:
        inside, where = [s for s in sizes if own[0] <= s <= own[1]], f"from {own[0]:g} to {own[1]:g} Fr"
    else:
        inside = [s for s in sizes if abs(s - size) <= share * size]
        where = f"within {100 * share:g} % of {size:g} Fr"
    if len(inside) < 2:
        sold = ", ".join(f"{s:g}" for s in sizes)
        raise InputError([f"{name}: fewer than two sizes {where}; sizes sold: {sold} Fr"])
    return Categorical(name, tuple(f"{s:g} Fr" for s in inside), ((name, tuple(inside)),))


def _check_ranges(inputs: Sequence[Input], case: Case) -> None:
    wrong = []
    for chosen in inputs:
        if not isinstance(chosen, Continuous):
            continue
        allowed = _allowed_range(chosen.name, case)
        if np.isnan(chosen.low):
            wrong.append(f"{chosen.name}: is solved with the beat; give it a value in the case, to vary it")
        elif chosen.low >= chosen.high:
            wrong.append(
                f"{chosen.name}: its value is {chosen.low:g}, so a percentage of it does not vary it"
                + follows_blood_hint(chosen.name)
            )
        elif allowed and not allowed[0] <= chosen.low <= chosen.high <= allowed[1]:
            reached = f"{chosen.low:g} to {chosen.high:g}; allowed: {allowed[0]:g} to {allowed[1]:g}"
            own = f"range of {chosen.name}: {reached}"
            low, high = max(chosen.low, allowed[0]), min(chosen.high, allowed[1])
            way = f"; give a range within it, as by --range {chosen.name}={low:g}:{high:g}"
            way = way if low < high else ""
            wrong.append(own if chosen.own else f"{chosen.name}: the perturbation reaches {reached}{way}")
    if wrong:
        raise InputError(wrong)


def _range_warnings(inputs: Sequence[Input], base: Mapping[str, float], share: float) -> Iterator[str]:
    """Sentences about ranges that are cut at a bound, or do not contain the value of the case."""
    for chosen in inputs:
        if not isinstance(chosen, Continuous):
            continue
        name, value, unit = chosen.name, base[chosen.name], unit_of_value(chosen.name)
        range_ = f"{chosen.low:g} to {chosen.high:g}{_after(unit)}"
        if chosen.own and not chosen.low <= value <= chosen.high:
            yield f"{RANGE_OF}{name}, {range_}, does not contain the value of the case, {value:g}"
        if chosen.own or (parameter := parameters().get(name)) is None:
            continue
        low, high = replace(parameter, clipped=False).varied(value, share)
        if (low, high) != (chosen.low, chosen.high):
            yield (
                f"{RANGE_OF}{name} is cut at what is allowed: {range_} in place of {low:g} to {high:g}; "
                "--range sets another"
            )


def _after(unit: str) -> str:
    """A unit after a number; nothing for a share."""
    return f" {unit}" if unit not in ("", "1") else ""


def _allowed_range(name: str, case: Case) -> tuple[float, float] | None:
    """Range of a parameter, of a speed, or of another number of a device's section."""
    if (parameter := parameter_of(name, [device.key for device in case.instances()])) is not None:
        return parameter.minimum, parameter.maximum
    section, _, key = name.rpartition(".")
    device = case.instance(section)
    if device is None:
        return None
    sweep = device.device.sweep(device.section)
    if sweep is not None and sweep.key == key:
        return float(sweep.low), float(sweep.high)
    field = device.device.section.fields().get(key)
    return None if field is None else (field.minimum, field.maximum)


# --- standard uncertainties of the measurements -----------------------------------------------------


def read_uncertainties(text: str) -> dict[str, Uncertainty]:
    """Parse "SP=4,CO=10%": numbers in the unit of the output, or percent of its value.

    Raises:
        InputError: A part has another form, or a name is given twice.
    """
    result: dict[str, Uncertainty] = {}
    wrong = []
    for part in named_texts([text]):
        name, number = part.name, part.text
        try:
            value = float(number.removesuffix("%"))
        except ValueError:
            value = 0.0
        if not value > 0.0 or value == float("inf"):
            wrong.append(
                f"--uncertainty {part.written}: allowed: NAME=VALUE or NAME=PERCENT%, above 0, such as CO=10%"
            )
        elif name in result:
            wrong.append(f"--uncertainty {part.written}: {part.twice}")
        elif number.endswith("%") and value > 100.0:
            wrong.append(
                f"--uncertainty {part.written}: so large an uncertainty carries no information; allowed: up "
                "to 100%, or leave the measurement out"
            )
        else:
            result[name] = Uncertainty(relative=value / 100.0) if number.endswith("%") else Uncertainty(value)
    if wrong:
        raise InputError(wrong)
    return result


def uncertainties_of(outputs: Sequence[str], stated: Mapping[str, Uncertainty]) -> dict[str, Uncertainty]:
    """Return the uncertainty of each output: the stated one, else the default."""
    as_uncertainties(stated)
    wrong = [f"uncertainty of {name}: not among the measurements" for name in stated if name not in outputs]
    known = {**DEFAULTS, **stated}
    wrong += [
        f"uncertainty of {name}: no default; give one, such as {name}=5%, in Python "
        f'{{"{name}": eclsim.Uncertainty(relative=0.05)}}'
        for name in outputs
        if name not in known
    ]
    if wrong:
        raise InputError(wrong)
    return {name: known[name] for name in outputs}
