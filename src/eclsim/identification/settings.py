"""Settings of a fit: free parameters with bounds, weights, extent of the search."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from eclsim.arguments import Kind, OneOf, check_fields, number_of, written
from eclsim.cases.doubts import speeds_too_low
from eclsim.cases.quantities import quantity, stated, with_values
from eclsim.cases.resolve import height_weight
from eclsim.cases.sections import MEASURED_GASES
from eclsim.components.base import names_in
from eclsim.devices.description import GASES as VO2
from eclsim.devices.ecmo import ECMO
from eclsim.devices.registry import example_setting, parameters
from eclsim.gas.network import drainages
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.quantities import BEAT_OUTPUTS, OUTPUTS, Scale, unit_of
from eclsim.inputs.mistakes import CaseError, InputError, Mistake, Remarks, as_names, shown
from eclsim.inputs.named_values import named_texts
from eclsim.inputs.sections import NOT_FITTED
from eclsim.orbit.model import VolumePolicy, circuit_of
from eclsim.orbit.status import NoDerivativesError
from eclsim.outputs.registry import unavailable
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.outputs.uncertainty import DEFAULTS, Uncertainty, as_uncertainties, measurement_errors
from eclsim.parameters.regulation import (
    EXTRA_VOLUME,
    PACO2_SET_POINT,
    PAO2_SET_POINT,
    REGULATION,
    SET_POINT,
    VENOUS_SET_POINT,
)
from eclsim.parameters.thiel2025 import BOUNDS
from eclsim.patient.anthropometry import oxygen_consumption
from eclsim.patient.sites import ARTERIAL_SITES
from eclsim.sensitivity.identifiability import identifiability, propose
from eclsim.spelling import did_you_mean

if TYPE_CHECKING:
    from eclsim.cases.case import Case

DEFAULT_BOUND_FACTOR = 10.0
"""Default bounds of a parameter: its value divided and multiplied by this factor."""
SMALLEST_USUAL_SHARE = 0.05
"""Stated uncertainties below this share of the default one are warned of, such as 10 % of a CVP near 0, and
those of which the default one is a smaller share."""
LEFT_VENTRICLE = "Emaxlv"
SHUNT = "gas.shunt_fraction"
CLOTTED = "ecmo.oxygenator.clotted_fraction"
INFORMATIVE_MEASUREMENTS = {
    EXTRA_VOLUME: ("how much blood there is", ("CVP",)),
    SHUNT: ("the shunt of the lungs", ("SaO2", "PaO2")),
    VO2: ("the oxygen that the tissues consume", ("SvO2", "SpreO2")),
    "gas.alveolar_ventilation_l_min": ("how much the lungs are ventilated", ("PaCO2",)),
    CLOTTED: ("how much of the oxygenator is clotted", ("SpostO2", "PpostO2", "PexhaustCO2")),
    "Dcrrttuin": ("the bore of the CRRT's access line with its catheter", ("crrt_access_pressure",)),
    "Dcrrttuout": ("the bore of the CRRT's return line with its catheter", ("crrt_return_pressure",)),
    "Rcrrtfil": ("how far the filter of the CRRT is clotted", ("crrt_filter_pressure_drop",)),
}
"""By parameter, its meaning and the measurements that carry information about it."""
CRRT_PARAMETERS = ("Dcrrttuin", "Dcrrttuout", "Rcrrtfil")
"""Diameters of the lines of a CRRT and the resistance of its filter."""
INFORMATIVE_GASES = {
    SHUNT: INFORMATIVE_MEASUREMENTS[SHUNT][1],
    VO2: INFORMATIVE_MEASUREMENTS[VO2][1],
    "ecmo.drainage_mixing": ("SpreO2",),
    CLOTTED: INFORMATIVE_MEASUREMENTS[CLOTTED][1],
}  # fmt: skip
"""Parameters of gas exchange, and the measured gases that carry information about them."""
MEASURED_AT_REST = {
    SET_POINT: "MAP", VENOUS_SET_POINT: "CVP", PAO2_SET_POINT: "PaO2", PACO2_SET_POINT: "PaCO2",
}  # fmt: skip
"""Set points of reflexes, and the measurements that equal them if the patient is measured at rest."""


BOUNDS_WRITTEN = 'lower and upper bound by parameter, such as {"Rmc": (0.1, 2.0)}'


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit of data points.

    Args:
        parameters: free parameters.
        bounds: lower and upper bounds that differ from the default ones.
        weights: "relative", (simulated - measured) / measured as in the paper, or "uncertainty",
            (simulated - measured) / standard uncertainty.
        uncertainties: standard uncertainties of measurements that differ from the defaults. They judge the
            fit and give its intervals; with the weights "uncertainty" they also weight the measurements.
        multi_start: extent of the search.
        volume_policy: blood volume policy; None takes that of the cases.
        shared: free parameters with a common value for all data points of a patient in a cohort.
    """

    parameters: tuple[str, ...] = tuple(BOUNDS)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    weights: Literal["relative", "uncertainty"] = "relative"
    uncertainties: Mapping[str, Uncertainty] = field(default_factory=dict)
    multi_start: MultiStart = field(default_factory=MultiStart)
    volume_policy: VolumePolicy | None = None
    shared: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what in ("parameters", "shared"):
            object.__setattr__(self, what, as_names(getattr(self, what), what))
        check_fields(
            self,
            weights=OneOf(("relative", "uncertainty")),
            multi_start=Kind(MultiStart, "eclsim.MultiStart(...)"),
        )
        as_uncertainties(self.uncertainties)
        Kind(Mapping, BOUNDS_WRITTEN)("bounds", self.bounds)
        pairs = {name: _pair(name, bounds) for name, bounds in self.bounds.items()}
        object.__setattr__(self, "bounds", pairs)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all free parameters, including the shared ones."""
        return tuple(dict.fromkeys([*self.parameters, *self.shared]))

    def as_object(self) -> dict[str, Any]:
        """Plain data; fits with equal objects give the same numbers."""
        return {
            "parameters": list(self.parameters),
            "bounds": {k: list(v) for k, v in self.bounds.items()},
            "weights": self.weights,
            "uncertainties": {k: [u.absolute, u.relative] for k, u in self.uncertainties.items()},
            **vars(self.multi_start),
            "blood_volume_policy": self.volume_policy,
            "shared": list(self.shared),
        }


def _pair(name: object, bounds: Any) -> tuple[float, float]:
    """Return bounds as two plain numbers; an error is raised for anything else, or a name that is no text."""
    pair = [*bounds] if isinstance(bounds, (tuple, list)) or hasattr(bounds, "__array__") else []
    if len(pair) != 2 or not isinstance(name, str):
        raise TypeError(f"bounds of {written(name)} = {written(bounds)}; allowed: {BOUNDS_WRITTEN}")
    low, high = (number_of(f"a bound of {name}", number) for number in pair)
    return low, high


@dataclass(slots=True)
class CheckedFit(Remarks):
    """Targets and free parameters of a fit, with mistakes, doubts, and notes on what was left out or fixed.

    Attributes:
        targets: measured values by name [mmHg, L/min].
        free: start value, lower and upper bound of each free parameter.
        fixed: value of each parameter whose bounds are equal.
    """

    targets: dict[str, float] = field(default_factory=dict)
    free: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)


def case_to_fit(case: Case, settings: FitSettings) -> Case:
    """Prepare a case for a fit: section for a free blood volume, set points from measurements, no verdict.

    Measurements become open set points, so that reflexes do not act at rest. Data points that share
    parameters keep set points open: a patient has one, not one per data point.
    """
    case = case.model_copy(update={"fit_mark": None})
    if EXTRA_VOLUME in settings.names and case.fluid is None:
        case = with_values(case, {EXTRA_VOLUME: 0.0})
    return case if settings.shared else with_values(case, measured_open_set_points(case))


def measured_open_set_points(case: Case) -> dict[str, float]:
    """Measurements that equal set points which a case leaves open, by key of the set point."""
    open_ones = MEASURED_AT_REST.keys() & case.open_set_points
    if case.physiology is not None and case.physiology.pericardium:
        open_ones -= {VENOUS_SET_POINT}  # transmural: the pressure around the heart is not measured
    measured = {key: getattr(case.measurements, MEASURED_AT_REST[key], None) for key in sorted(open_ones)}
    return {k: v for k, v in measured.items() if v is not None and parameters()[k].accepts(v)}


def measured_outputs(case: Case) -> list[str]:
    """Names of the measurements of a case that can be fitted."""
    return [name for name in OUTPUTS if getattr(case.measurements, name, None) is not None]


def _computed_measurements(case: Case) -> list[str]:
    available = output_names(circuit_of(case))
    return [name for name in measured_outputs(case) if name in available]


def free_parameters(
    case: Case, usual: Sequence[str] = tuple(BOUNDS), policy: VolumePolicy | None = None
) -> tuple[str, ...]:
    """Parameters to fit to a case: the usual ones, or with measured gases those that can be determined.

    If a wrong shunt or oxygen consumption is held, the fitted cardiac output compensates for it. Both, and
    the mixing where drained blood is recirculated, therefore come first, followed by the usual parameters
    whose effects differ from theirs at the values of the case. A consumption that the case gives is held.
    On V-A ECMO the contractility of the left ventricle is free as well, even if its effect is like that of
    others: held at a healthy value, it makes a wedge pressure of 3 mmHg certain where it may be 20.

    Args:
        case: case with measurements.
        usual: names of the usual parameters.
        policy: blood volume policy; None takes that of the case.
    """
    unknown = parameters_informed_by_gases(case)
    if not unknown:
        return tuple(usual)
    candidates = tuple(dict.fromkeys((*unknown, *usual)))
    try:
        outputs = _computed_measurements(case)
        about = identifiability(case, parameters=candidates, outputs=outputs, volume_policy=policy)
    except NoDerivativesError:
        return candidates
    # An oxygenator counts as new unless the gases show otherwise, so its clotting has no priority.
    assumed = [key for key in unknown if key != CLOTTED]
    chosen = propose(about.scaled, first=assumed).chosen
    more = [LEFT_VENTRICLE] if returns_to_arteries(case) else []
    # At the assumed shunt its effect may be too small to be seen, which says nothing about the patient's.
    for name in (*(key for key in assumed if key in (SHUNT, VO2)), *more):
        if name not in chosen and 0 < len(chosen) < len(outputs):
            chosen = (*chosen, name)
    return tuple(name for name in candidates if name in chosen) or candidates


def returns_to_arteries(case: Case) -> bool:
    """Whether an ECMO circuit of a case returns blood to the arteries, beside a left ventricle that fails."""
    sections = [one.section for one in case.instances() if one.device.key == ECMO.key]
    sites = {getattr(section, name) for section in sections for name in ("return_site", "second_return_site")}
    return bool(sites & {*ARTERIAL_SITES})


def _unknown_gas_parameters(case: Case) -> set[str]:
    """Keys of `INFORMATIVE_GASES` that a case uses and does not give."""
    if case.gas is None:
        return set()
    circuit = circuit_of(case)
    mixing = {name for drained in drainages(circuit) for name in names_in(drained.mixing)}
    clotted = [CLOTTED] if _oxygenator_is_fixed(case, ()) else []
    return {SHUNT, *assumed_gas_parameters(case), *mixing, *clotted}


def parameters_informed_by_gases(case: Case) -> tuple[str, ...]:
    """Parameters of gas exchange that a case leaves open and that its measured gases inform on."""
    measured, unknown = {*_computed_measurements(case)}, _unknown_gas_parameters(case)
    return tuple(key for key, gases in INFORMATIVE_GASES.items() if key in unknown and {*gases} & measured)


def crrt_parameters_informed_by_pressures(case: Case) -> tuple[str, ...]:
    """Lines and filter of a CRRT whose pressures were measured and which the case does not give."""
    measured, read = {*measured_outputs(case)}, parameters_read(circuit_of(case))
    unknown = [name for name in CRRT_PARAMETERS if name in read and stated(case, name) is None]
    return tuple(name for name in unknown if {*INFORMATIVE_MEASUREMENTS[name][1]} & measured)


def parameters_informed_by_pressures(case: Case) -> tuple[str, ...]:
    """Blood volume and CRRT parameters that a case leaves open and that its measured pressures inform on."""
    informative = {*INFORMATIVE_MEASUREMENTS[EXTRA_VOLUME][1]} & {*measured_outputs(case)}
    volume = (EXTRA_VOLUME,) if informative and _volume_is_fixed(case, ()) else ()
    return (*volume, *crrt_parameters_informed_by_pressures(case))


def assumed_gas_parameters(case: Case) -> set[str]:
    """Shunt and oxygen consumption, as far as a case leaves them out and they are assumed."""
    if case.gas is None:
        return set()
    shunt = set() if "shunt_fraction" in case.gas.model_fields_set else {SHUNT}
    return shunt | ({VO2} if case.gas.vo2_ml_min is None else set())


def avoidable_assumptions(case: Case, measured: Collection[str], free: Collection[str]) -> list[str]:
    """Warnings about parameters held at assumed values that the measurements could determine."""
    result = []
    for key in sorted(assumed_gas_parameters(case) - set(free)):
        meaning, informative = INFORMATIVE_MEASUREMENTS[key]
        if names := [name for name in informative if name in measured]:
            result.append(
                f"{meaning} is held at an assumed value although {', '.join(names)} would help to determine "
                "it: other parameters, and with them cardiac output, compensate for its error; free it "
                f"(--parameters Rmc,{SHUNT},{VO2}) or give {key}"
            )
    if _volume_is_fixed(case, free) and {*INFORMATIVE_MEASUREMENTS[EXTRA_VOLUME][1]} & {*measured}:
        result.append(
            "the blood volume is held at that of a published patient of this size although CVP depends on "
            "it: other parameters compensate for its error, and "
            f"{_volume_dependent(measured)} depend on it; free it as well ({EXTRA_VOLUME}) or give it"
        )
    return result


def remarks_on_fixed_consumption(case: Case, measured: Collection[str], free: Collection[str]) -> list[str]:
    """A remark if the oxygen consumption is the formula's and no measured gas determines it, else empty."""
    gases = [name for name in MEASURED_GASES if name in measured]
    determined = {*gases} & {*INFORMATIVE_MEASUREMENTS[VO2][1]}
    if not gases or determined or VO2 not in assumed_gas_parameters(case) - {*free}:
        return []
    return [
        f"the oxygen consumption is held at a formula's value, on which {', '.join(gases)} depend: the shunt "
        f"is only as good as that value; measure SvO2 or SpreO2, or give {VO2}"
    ]


def remarks_on_undetermined_output(
    case: Case, measured: Collection[str], measured_at_any_time: Collection[str], free: Collection[str]
) -> list[str]:
    """A warning if only gases inform on the cardiac output and the consumption is free, too, else empty.

    Args:
        case: case of a series.
        measured: names of the measurements of this case.
        measured_at_any_time: names of the measurements of the whole series.
        free: names of the free parameters.
    """
    gases = [name for name in MEASURED_GASES if name in measured]
    if not gases or "CO" in measured_at_any_time or VO2 not in assumed_gas_parameters(case) & {*free}:
        return []
    return [
        "CO: no measurement determines the cardiac output, since more output, more consumption, less shunt "
        f"and less resistance together fit {', '.join(gases)} as well; the estimate tends to be too high, "
        "and in simulated patients its 90 % interval missed the truth by up to 1.7 L/min: measure CO, or "
        f"give {VO2}"
    ]


def remarks_on_assumptions(case: Case, measured: Collection[str], free: Collection[str]) -> dict[str, str]:
    """Remarks on what no measurement determines, by parameter: a blood volume, the clot of an oxygenator."""
    remarks = {}
    if _volume_is_fixed(case, free) and not {*INFORMATIVE_MEASUREMENTS[EXTRA_VOLUME][1]} & {*measured}:
        remarks[EXTRA_VOLUME] = (
            "the blood volume is held at that of a published patient of this size: "
            f"{_volume_dependent(measured)} depend on it, and intervals do not include its uncertainty; "
            f"measure CVP and free {EXTRA_VOLUME}"
        )
    behind, gases = INFORMATIVE_MEASUREMENTS[CLOTTED][1], [g for g in MEASURED_GASES if g in measured]
    advice = f"measure a gas behind it ({', '.join(behind)}), or give {CLOTTED}"
    if not gases or {*behind} & {*measured}:
        return remarks
    if {CLOTTED, SHUNT} <= {*free}:
        remarks[CLOTTED] = (
            f"no gas behind the oxygenator was measured: {', '.join(gases)} hardly distinguish a clotted "
            f"oxygenator from sicker lungs, and a change in one may be attributed to the other; {advice}"
        )
    elif _oxygenator_is_fixed(case, free):
        remarks[CLOTTED] = (
            f"the oxygenator is assumed to be as new, and {', '.join(gases)} depend on it: a clotted one "
            f"appears as sicker lungs; {advice}"
        )
    return remarks


def remarks_on_unfitted(case: Case, fitted: Collection[str]) -> list[str]:
    """A sentence about measurements that are not fitted, since the case has no such outputs."""
    names = [name for name in measured_outputs(case) if name not in fitted]
    if not names:
        return []
    why = unavailable(names[0], output_names(circuit_of(case)))
    return [f"{', '.join(names)}: measured and not fitted, since the case has no such output{why}"]


def _oxygenator_is_fixed(case: Case, free: Collection[str]) -> bool:
    left = CLOTTED not in free and stated(case, CLOTTED) is None
    return left and CLOTTED in parameters_read(circuit_of(case))


def _volume_is_fixed(case: Case, free: Collection[str]) -> bool:
    return EXTRA_VOLUME not in free and not stated(case, EXTRA_VOLUME)


def _volume_dependent(measured: Collection[str]) -> str:
    """Unmeasured outputs that depend on the blood volume, as text."""
    pressures = [name for name in ("PCWP", "MPAP", "CVP") if name not in measured]
    return " and ".join(filter(None, (", ".join(pressures), "the volumes of the heart")))


def checked_fit(case: Case, settings: FitSettings) -> CheckedFit:
    """Return checked targets and bounds of a case, with mistakes, warnings and notes."""
    left_open = case.open_set_points
    without_fluid, case = case.fluid is None, case_to_fit(case, settings)
    # Quantities that a case leaves open and that follow from the patient's body surface area.
    defaults = {} if case.gas is None else {VO2: oxygen_consumption(*height_weight(case.patient))}
    limits = {name: _bounds(name, case, settings.bounds, defaults) for name in settings.names}
    checked = check_fit(case, limits)
    read = parameters_read(circuit_of(case))
    for name in [*checked.free, *checked.fixed]:
        if name not in read:
            checked.error(name, "not read by the circuit of this case, so it cannot be fitted")
        elif limits[name][1] <= 0.0 and not Scale.of([name]).linear[0]:
            checked.error(name, "is sought on a logarithmic scale: its lower bound must be above 0")
    checked.warnings += _values_out_of_bounds(case, checked.free)
    _check_uncertainties(checked, settings.uncertainties)
    for name in settings.bounds:
        if name not in settings.names:
            hint, allowed = did_you_mean(name, settings.names), ", ".join(settings.names)
            checked.error(name, "bounds of a parameter that is not free", "", allowed, hint)
    for key in left_open:
        if key in case.open_set_points:
            checked.warning(
                key, f"left open, so the start value is used: give it, or fit without [{REGULATION}]"
            )
        else:
            measured = MEASURED_AT_REST[key]
            checked.note(key, f"left open, so the measured {measured} is used: reflexes are inactive there")
    if without_fluid and EXTRA_VOLUME in checked.free:
        checked.note(EXTRA_VOLUME, "free, so the fitted case has the section [fluid]")
    if not checked.mistakes and not checked.free:
        checked.error("parameters", "none is free")
    return checked


def _check_uncertainties(checked: CheckedFit, stated_ones: Mapping[str, Uncertainty]) -> None:
    """Add a mistake for each uncertainty of 0, a warning for each far from the usual one."""
    given = {name: stated_ones[name] for name in stated_ones if name in checked.targets}
    try:
        errors = measurement_errors({name: checked.targets[name] for name in given}, given)
    except InputError as error:
        for sentence in error.mistakes:
            checked.error("uncertainty", sentence.removeprefix("uncertainty of "))
        return
    for name, error in errors.items():
        usual, unit = DEFAULTS[name].at(checked.targets[name]), unit_of(name)
        if error < SMALLEST_USUAL_SHARE * usual:
            effect = f"below the usual {usual:.2g}, so the fit follows this measurement above all"
        elif SMALLEST_USUAL_SHARE * error > usual:
            effect = f"above the usual {usual:.2g}, so this measurement hardly counts, met or not"
        else:
            continue
        text = f"uncertainty {error:.2g} {unit} at the measured {checked.targets[name]:g}: far {effect}"
        checked.warning(f"measurements.{name}", text)


def _values_out_of_bounds(case: Case, free: Mapping[str, tuple[float, float, float]]) -> list[Mistake]:
    """Return a mistake for each free parameter whose value in the case is outside its bounds."""
    result = []
    for name, (start, lower, upper) in free.items():
        value = stated(case, name)
        if value is not None and not lower <= value <= upper:
            message = f"the case's own value is not within its bounds: the search starts at {start:g} instead"
            wider = f"--bounds {name}={min(lower, value):g}:{max(upper, value):g}"
            result.append(Mistake(name, message, shown(value), f"{lower:g} to {upper:g}", wider))
    return result


def check_fit(case: Case, bounds: Mapping[str, tuple[float, float, float]]) -> CheckedFit:
    """Check targets and bounds before anything is fitted; never raises.

    Args:
        case: case whose measurements are the targets.
        bounds: start value, lower and upper bound of each free parameter, in the parameter's unit,
            such as `eclsim.parameters.thiel2025.BOUNDS`.
    """
    checked = CheckedFit()
    for instance, target in case.targets():
        allowed = f"{instance.key}.{target.setting} instead; a measured pump flow is measurements.PF"
        message = "a target; a fit needs the speed at which the pump ran"
        value = shown(getattr(instance.section, target.key))
        checked.error(f"{instance.key}.{target.key}", message, value, allowed)
    checked.mistakes += speeds_too_low(case)
    known = output_names(circuit_of(case))
    for name in OUTPUTS:
        value = getattr(case.measurements, name, None)
        if value is None and name in BEAT_OUTPUTS:
            checked.note(f"measurements.{name}", NOT_FITTED)
        elif value is not None and name not in known:
            message = f"not fitted: the case has no such output{unavailable(name, known)}"
            checked.warning(f"measurements.{name}", message, shown(value))
        elif value is not None:
            checked.targets[name] = value
    if not checked.targets:
        checked.error("measurements", "nothing to fit", allowed=f"at least one of {', '.join(OUTPUTS)}")
    for key, limits in bounds.items():
        _check_bounds(key, limits, checked)
    if 0 < len(checked.targets) < len(checked.free):
        counts = f"{len(checked.targets)} targets for {len(checked.free)} free parameters"
        checked.warning("measurements", f"under-determined: {counts}")
    return checked


def _check_bounds(key: str, limits: tuple[float, float, float], checked: CheckedFit) -> None:
    start, lower, upper = limits
    written, parameter = f"{start:g}, {lower:g} to {upper:g}", quantity(key)
    if parameter is None:
        allowed = f"names listed by eclsim parameters, or keys of sections such as {example_setting()}"
        hint = did_you_mean(key, parameters())
        checked.error(key, "unknown parameter", allowed=allowed, suggestion=hint)
    elif not all(math.isfinite(number) for number in limits):
        checked.error(key, "start and bounds must be finite", written, parameter.allowed)
    elif lower > upper:
        hint = f"{upper:g} to {lower:g}"
        checked.error(key, "lower bound above upper bound", written, parameter.allowed, hint)
    elif not lower <= start <= upper:
        checked.error(key, "start value outside its bounds", written, parameter.allowed)
    elif not (parameter.accepts(lower) and parameter.accepts(upper)):
        checked.error(key, "bounds outside the allowed range", written, parameter.allowed)
    elif lower == upper:
        checked.fixed[key] = start
        checked.note(key, "bounds are equal: fixed, not fitted", shown(start))
    else:
        checked.free[key] = (start, lower, upper)


def common_policy(cases: Sequence[Case], chosen: str | None = None) -> str:
    """Return the blood volume policy of a joint fit of cases: the chosen one, else that of the cases.

    Raises:
        CaseError: The cases have different policies.
    """
    if chosen is not None:
        return chosen
    policies = {case.volume_policy: case.patient.id for case in cases}
    if len(policies) > 1:
        each = ", ".join(f"{policy} in {name}" for policy, name in policies.items())
        message = "cases fitted together need the same policy; choose one with --volume-policy"
        raise CaseError([Mistake("blood_volume_policy", message, each)])
    return next(iter(policies))


def unmeasured_uncertainties(cases: Iterable[Case], settings: FitSettings) -> list[Mistake]:
    """Return mistakes for uncertainties that have no effect, because no case has such a measurement."""
    measured = {n for case in cases for n in checked_fit(case, settings).targets}
    return without_measurement(settings.uncertainties, measured) if measured else []


def without_measurement(uncertainties: Iterable[str], measured: Collection[str]) -> list[Mistake]:
    """Return a mistake for each uncertainty, by name, of an output that was not measured."""
    allowed = ", ".join(n for n in DEFAULTS if n in measured)
    message = "not measured, so its uncertainty has no effect"
    return [Mistake("uncertainty", message, n, allowed) for n in uncertainties if n not in measured]


def _bounds(
    name: str, case: Case, bounds: Mapping[str, tuple[float, float]], defaults: Mapping[str, float]
) -> tuple[float, float, float]:
    """Return start value, lower and upper bound; the start is the case's own value if within the bounds."""
    known = quantity(name)
    if known is None:
        return (0.0, 0.0, 0.0)
    if known.bounds is not None:
        start, lower, upper = known.bounds
    elif known.is_linear:
        start, lower, upper = float(known.value), known.minimum, known.maximum
    else:
        start = float(known.value)
        lower = max(start / DEFAULT_BOUND_FACTOR, known.minimum)
        upper = min(start * DEFAULT_BOUND_FACTOR, known.maximum)
    value = stated(case, name)
    value = defaults.get(name, start) if value is None else value
    if name in bounds:
        lower, upper = bounds[name]
        middle = (lower * upper) ** 0.5 if 0.0 < lower <= upper else 0.5 * (lower + upper)
        start = start if lower <= start <= upper else middle
    if lower > upper:
        return (lower, lower, upper)
    return (value if lower <= value <= upper else start, lower, upper)


def read_bounds(text: str) -> dict[str, tuple[float, float]]:
    """Parse bounds such as "Rmc=0.1:2,Csart=0.5:5".

    Raises:
        InputError: Parts of the text are no pairs of numbers, or a name is given twice.
    """
    result: dict[str, tuple[float, float]] = {}
    wrong = []
    for part in named_texts([text]):
        lower, _, upper = part.text.partition(":")
        if part.name in result:
            wrong.append(f"--bounds {part.written}: {part.twice}")
            continue
        try:
            result[part.name] = float(lower), float(upper)
        except ValueError:
            wrong.append(f"--bounds {part.written}: allowed: NAME=LOWER:UPPER, such as Rmc=0.1:2")
    if wrong:
        raise InputError(wrong)
    return result
