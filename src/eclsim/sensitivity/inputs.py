"""What a sensitivity analysis varies: numbers within bounds and choices, around the values of a case.

By default the paper's 24 cardiovascular parameters; further inputs are settings of the devices, the maker's
sizes of cannulae, and the sites or the scheme of a CRRT.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.circuit.network import Choice, Circuit
from eclsim.devices.crrt import SCHEMES as CRRT_SCHEMES
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import CANNULAE, POSITIONS, PUMPS
from eclsim.parameters import did_you_mean, thiel2025

if TYPE_CHECKING:
    from eclsim.cases.case import Case

CARDIOVASCULAR = (
    "Rao", "Rsart", "Rmc", "Rsvn", "Rpas", "Rpart", "Rpmc", "Rpvn",
    "Cao", "Csart", "Csvn", "Cpas", "Cpart", "Cpvn", "Lao", "Lsart", "Lpas", "Lpart",
    "Edla", "Edra", "Emaxla", "Emaxlv", "Emaxra", "Emaxrv",
)  # fmt: skip
"""The parameters of the paper's global sensitivity analysis (Figure 3)."""

GROUPS = {"R": "resistance", "C": "compliance", "L": "inertance", "E": "elastance"}
"""What the unit of the parameters of a group measures."""
MOST_LISTED = 60
OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")

SCHEMES = dict(CRRT_SCHEMES)
"""Access and return position of the paper's nine connection schemes (Figure 2)."""

SCHEME, ACCESS, RETURN = "crrt.scheme", "crrt.access_site", "crrt.return_site"
_SITES = tuple(POSITIONS)


Description = dict[str, Any]
"""Plain data for JSON: what a design or a model is, for its file and for comparing it with another."""


class InputError(ValueError):
    """Inputs that a case cannot have; one line for each mistake."""

    def __init__(self, mistakes: Sequence[str]):
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(mistakes))


@dataclass(frozen=True)
class Continuous:
    """A number, uniform between two bounds.

    Args:
        name: parameter of the model.
        low: lower bound, in the parameter's unit.
        high: upper bound.
    """

    name: str
    low: float
    high: float

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameter for numbers in [0, 1), scaled as SALib does."""
        return {self.name: unit * (self.high - self.low) + self.low}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """What a table of samples shows."""
        return self.settings(unit)[self.name]

    def description(self) -> Description:
        """As plain data."""
        return {"name": self.name, "low": self.low, "high": self.high}


@dataclass(frozen=True)
class Categorical:
    """One of several choices, all equally likely; each choice sets one parameter or several.

    The choice is a function of the input's own coordinate in the design, so a row of the design that shares
    the coordinate shares the choice: what the estimators rely on.

    Args:
        name: of the input.
        levels: names of the choices.
        sets: parameter and its value for each level.
    """

    name: str
    levels: tuple[str, ...]
    sets: tuple[tuple[str, tuple[float, ...]], ...]

    def choose(self, unit: np.ndarray) -> np.ndarray:
        """Position of the chosen level for numbers in [0, 1)."""
        return np.minimum((unit * len(self.levels)).astype(int), len(self.levels) - 1)

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters that the choice sets."""
        chosen = self.choose(unit)
        return {parameter: np.asarray(values, dtype=float)[chosen] for parameter, values in self.sets}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """Names of the chosen levels."""
        return np.array(self.levels, dtype=object)[self.choose(unit)]

    def description(self) -> Description:
        """As plain data."""
        return {"name": self.name, "levels": list(self.levels), "sets": {p: list(v) for p, v in self.sets}}


Input = Continuous | Categorical


def described_input(description: Description) -> Input:
    """The input that a description came from."""
    if "levels" not in description:
        return Continuous(description["name"], description["low"], description["high"])
    sets = tuple((name, tuple(values)) for name, values in description["sets"].items())
    return Categorical(description["name"], tuple(description["levels"]), sets)


@dataclass(frozen=True)
class Varied:
    """What is varied around which model.

    Args:
        circuit: of the case; sites that are inputs are choices in it.
        base: a number for every parameter.
        inputs: what is varied.
        groups: factor of each input; empty where each is its own.
    """

    circuit: Circuit
    base: Mapping[str, float]
    inputs: tuple[Input, ...]
    groups: tuple[str, ...]


def varied(
    case: Case,
    base: Mapping[str, float],
    parameters: Sequence[str] = CARDIOVASCULAR,
    include: Sequence[str] = (),
    groups: Sequence[str] = (),
    perturbation_percent: float = 25.0,
) -> Varied:
    """Inputs of an analysis around a case.

    Args:
        case: patient and devices.
        base: values of all parameters, around which the inputs vary.
        parameters: names of parameters, uniform within the perturbation.
        include: further inputs: parameters, device settings, `crrt.scheme`, `crrt.access_site`, ...
        groups: kinds (R, C, L, E, see `GROUPS`) whose parameters are one factor together.
        perturbation_percent: half width of the range of each number.
    """
    circuit = _circuit(case, include)
    known = [*dict.fromkeys(("heart_rate_bpm", *circuit.parameter_names())), SCHEME, ACCESS, RETURN]
    wanted = [*parameters, *include]
    mistakes = unknown_names(wanted, known, "parameter that this case reads") + _wrong_groups(
        groups, parameters
    )
    if not 0.0 < perturbation_percent < 100.0:
        mistakes.append(f"perturbation {perturbation_percent:g} %: allowed: above 0 and below 100 %")
    if SCHEME in include and {ACCESS, RETURN} & set(include):
        mistakes.append(f"{SCHEME}: sets both sites already; leave out {ACCESS} and {RETURN}, or {SCHEME}")
    if mistakes:
        raise InputError(mistakes)
    base = dict(base)
    if case.crrt is not None and {SCHEME, ACCESS, RETURN} & set(include):
        base |= {
            site: float(_site(getattr(case.crrt, site.removeprefix("crrt.")))) for site in (ACCESS, RETURN)
        }
    names = [*dict.fromkeys([*parameters, *include])]
    inputs = tuple(_input(name, case, base, perturbation_percent / 100.0) for name in names)
    _check_ranges(inputs, case)
    kinds = {n: letter_of(n) for n in parameters}
    labels = tuple(kinds[n] if kinds.get(n) in groups else n for n in names) if groups else ()
    return Varied(circuit, base, inputs, labels)


def _circuit(case: Case, include: Sequence[str]) -> Circuit:
    from eclsim.orbit.model import circuit_of

    if not {SCHEME, ACCESS, RETURN} & set(include):
        return circuit_of(case)
    if case.ecmo is None or case.crrt is None:
        raise InputError([f"{SCHEME}, {ACCESS}, {RETURN}: the case needs the sections [ecmo] and [crrt]"])
    sites = tuple(POSITIONS.values())
    without = circuit_of(case.model_copy(update={"crrt": None}))
    return without + crrt(Choice(sites, ACCESS), Choice(sites, RETURN))


def unknown_names(names: Sequence[str], known: Sequence[str], kind: str) -> list[str]:
    """A sentence for each name that is not known, with the nearest spelling, else those allowed if few."""
    wrong = []
    for name in dict.fromkeys(names):
        if name not in known:
            hint = did_you_mean(name, known)
            allowed = f"; allowed: {', '.join(known)}" if len(known) <= MOST_LISTED else ""
            wrong.append(f"{name}: no {kind}" + (f"; did you mean {hint}?" if hint else allowed))
    return wrong


def letter_of(name: str) -> str:
    """Group of a parameter by what its unit measures; empty where it belongs to none."""
    parameter = thiel2025.PARAMETERS.get(name)
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


def _site(site: str) -> int:
    if site not in _SITES:
        raise InputError([f"crrt site {site}: as an input it is one of {', '.join(_SITES)}"])
    return _SITES.index(site)


def _input(name: str, case: Case, base: Mapping[str, float], share: float) -> Input:
    if name == SCHEME:
        access, back = (tuple(float(_SITES.index(pair[k])) for pair in SCHEMES.values()) for k in (0, 1))
        return Categorical(SCHEME, tuple(SCHEMES), ((ACCESS, access), (RETURN, back)))
    if name in (ACCESS, RETURN):
        return Categorical(name, _SITES, ((name, tuple(float(k) for k in range(len(_SITES)))),))
    if name in ("ecmo.drainage_fr", "ecmo.return_fr"):
        return _cannula_sizes(name, case, base[name], share)
    return Continuous(name, *sorted((base[name] * (1.0 - share), base[name] * (1.0 + share))))


def _cannula_sizes(name: str, case: Case, size: float, share: float) -> Categorical:
    """The maker's sizes within the perturbation."""
    assert case.ecmo is not None
    kind = case.ecmo.drainage_cannula if name == "ecmo.drainage_fr" else case.ecmo.return_cannula
    sizes = [float(s) for s in CANNULAE[kind].sizes_fr if abs(s - size) <= share * size]
    if len(sizes) < 2:
        raise InputError([f"{name}: fewer than two sizes within {100 * share:g} % of {size:g} Fr"])
    return Categorical(name, tuple(f"{s:g} Fr" for s in sizes), ((name, tuple(sizes)),))


def _check_ranges(inputs: Sequence[Input], case: Case) -> None:
    wrong = []
    for chosen in inputs:
        if not isinstance(chosen, Continuous):
            continue
        allowed = _allowed(chosen.name, case)
        if chosen.low >= chosen.high:
            wrong.append(
                f"{chosen.name}: its value is {chosen.low:g}, so a percentage of it does not vary it"
            )
        elif allowed and not allowed[0] <= chosen.low <= chosen.high <= allowed[1]:
            reached = f"{chosen.low:g} to {chosen.high:g}; allowed: {allowed[0]:g} to {allowed[1]:g}"
            wrong.append(f"{chosen.name}: the perturbation reaches {reached}")
    if wrong:
        raise InputError(wrong)


def _allowed(name: str, case: Case) -> tuple[float, float] | None:
    if name in thiel2025.PARAMETERS:
        parameter = thiel2025.PARAMETERS[name]
        return parameter.minimum, parameter.maximum
    if name == "ecmo.speed_rpm" and case.ecmo is not None and isinstance(case.ecmo.pump, str):
        low, high = PUMPS[case.ecmo.pump].speed_range_rpm
        return float(low), float(high)
    return None
