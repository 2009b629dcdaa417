"""Rules for ranking schemes: ordered criteria with bounds or preferred directions.

A rule's file is TOML:

    name = "our centre"
    [limits]                             # optional, else the default limits
    access_alarm = [-200, 250]           # mmHg; also return_alarm, access_190, suction; inf for none
    [[criteria]]                         # optional, else the default ones; later ones decide ties
    quantity = "alarms"
    at_least = 0
    [[criteria]]
    quantity = "effective_clearance_urea"
    prefer = "larger"
    step = 0.5
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, field_validator

from eclsim.crrt_study.limits import LIMITS, Limit, any_bounded
from eclsim.outputs.registry import find_output, unavailable
from eclsim.spelling import spelling_hint

FLOW = "largest_flow"
ON_PATIENT = "lines_on_patient"
PAST_OXYGENATOR = "past_oxygenator"
RULE_QUANTITIES = (
    "alarms",
    "margin",
    *(limit.name for limit in LIMITS),
    "lowest_site_pressure",
    ON_PATIENT,
    FLOW,
)
"""Quantities that a rule may use in addition to all pressures, flows and outputs of the study."""


class RuleError(ValueError):
    """Raised for a rule that cannot be used; the message has one line for each mistake."""


_NO_NUMBER = "allowed: a number, not true or false"


def _not_boolean(value: object) -> object:
    """Return a value as it is; true and false, which pydantic would read as 1 and 0, are refused."""
    if isinstance(value, bool):
        raise ValueError(_NO_NUMBER)
    return value


_Number = Annotated[float, BeforeValidator(_not_boolean)]


@dataclass(frozen=True)
class Criterion:
    """One criterion of a rule.

    Args:
        quantity: quantity of the study at the case's speed.
        at_least: smallest value that meets the criterion.
        at_most: largest value that meets the criterion.
        prefer: preferred direction, if there is no bound.
        step: with a preferred direction, values are rounded to multiples of it before they are compared.
        words: description of the criterion.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")
    quantity: str
    at_least: _Number | None = None
    at_most: _Number | None = None
    prefer: Literal["larger", "smaller"] | None = None
    step: _Number = 0.0
    words: str = ""

    def __post_init__(self) -> None:
        """Check that there is either a bound or a direction, and that numbers are valid."""
        if (self.prefer is None) == (self.at_least is None and self.at_most is None):
            raise ValueError('allowed: at_least or at_most, or prefer = "larger" or "smaller"')
        for name in ("at_least", "at_most", "step"):
            number = getattr(self, name)
            if isinstance(number, bool):
                raise ValueError(f"{name} = {str(number).lower()}: {_NO_NUMBER}")
            if number is not None and not math.isfinite(number):
                raise ValueError(f"{name} = {number:g}: allowed: finite numbers; leave it out for none")
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise ValueError(
                f"at_least = {self.at_least:g}, at_most = {self.at_most:g}: no value meets both; allowed: "
                "at_least below at_most"
            )
        if self.step < 0.0:
            raise ValueError(f"step = {self.step:g}: allowed: zero or above")
        if self.step and self.prefer is None:
            raise ValueError(f"step = {self.step:g}: allowed: with prefer; a bound is compared unrounded")

    def key(self, value: float) -> float:
        """Sort key: smaller is better; unknown values are worst."""
        if self.prefer is None:
            low, high = self.at_least, self.at_most
            return float(not ((low is None or value >= low) and (high is None or value <= high)))
        if math.isnan(value):
            return math.inf
        rounded = float(np.round(value / self.step)) if self.step else value
        return -rounded if self.prefer == "larger" else rounded

    @property
    def sentence(self) -> str:
        """The criterion in words."""
        if self.words:
            return self.words
        bounds = {"at least": self.at_least, "at most": self.at_most}
        terms = [f"{word} {bound:g}" for word, bound in bounds.items() if bound is not None]
        text = " and ".join(terms) or f"the {self.prefer}"
        return f"{self.quantity}: {text}" + (f", rounded to {self.step:g}" if self.step else "")


@dataclass(frozen=True)
class Rule:
    """A rule for ranking schemes.

    Args:
        name: name of the rule, such as that of its centre.
        criteria: criteria in order of priority.
        limits: limits of machine and circuit.
    """

    name: str
    criteria: tuple[Criterion, ...]
    limits: tuple[Limit, ...] = LIMITS

    def decides(self, first: Mapping[str, float], second: Mapping[str, float]) -> Criterion | None:
        """First criterion in which the numbers of two schemes differ; None if an earlier one is unknown."""
        for criterion in self.criteria:
            numbers = [numbers[criterion.quantity] for numbers in (first, second)]
            if criterion.quantity != FLOW and any(map(math.isnan, numbers)):
                return None
            if criterion.key(numbers[0]) != criterion.key(numbers[1]):
                return criterion
        return None

    @property
    def limited(self) -> bool:
        """Whether any limit of the CRRT lines has a bound."""
        return any_bounded(limit for limit in self.limits if limit.of_crrt)

    @property
    def access_mmhg(self) -> float:
        """Upper limit of the access pressure [mmHg], besides its alarm."""
        return next(limit.high for limit in self.limits if limit.name == "access_190")

    def as_object(self) -> dict[str, object]:
        """Plain data that `read_rule` also accepts; an infinite bound is None."""
        criteria = [
            {k: v for k, v in asdict(criterion).items() if v not in (None, "")} for criterion in self.criteria
        ]
        bounds = {o.name: [None if math.isinf(b) else b for b in (o.low, o.high)] for o in self.limits}
        return {"name": self.name, "criteria": criteria, "limits": bounds}


def default_criteria(limits: tuple[Limit, ...] = LIMITS) -> tuple[Criterion, ...]:
    """Criteria of the default rule, with descriptions that give the bounds of these limits."""
    access = next(limit for limit in limits if limit.name == "access_190")
    if math.isinf(access.low) and math.isinf(access.high):
        kept = "has no limit of the access pressure"
    elif math.isinf(access.low):
        kept = f"keeps the access pressure below {access.high:g} mmHg at this speed"
    else:
        kept = f"keeps the access pressure within {access.low:g} and {access.high:g} mmHg at this speed"
    return (
        Criterion("alarms", at_least=0.0, words="keeps the machine's pressure alarms at this speed"),
        Criterion(access.name, at_least=0.0, words=kept),
        Criterion(
            ON_PATIENT, at_most=0.0,
            words="has both lines on the ECMO circuit (on the patient a catheter's resistance is missing: "
            "pressures of its lines are too mild)",
        ),
        Criterion(
            "lowest_site_pressure", at_least=0.0,
            words="draws and returns above atmospheric pressure (no air can be drawn in)",
        ),
        Criterion(
            PAST_OXYGENATOR, prefer="smaller", step=0.01,
            words="carries less of the ECMO's blood past the oxygenator, rounded to 1 %",
        ),
        Criterion(
            FLOW, prefer="larger", step=0.1,
            words="keeps its limits up to a larger ECMO flow (rounded to 0.1 L/min, and up to the largest "
            "speed studied)",
        ),
        Criterion(
            "recirculated_fraction", prefer="smaller", step=0.01, words="recirculates less, rounded to 1 %"
        ),
        Criterion("margin", prefer="larger", words="is further from its nearest limit at this speed"),
    )  # fmt: skip


DEFAULT_RULE = Rule("the usual rule", default_criteria())


class _RuleFile(BaseModel):
    """Contents of a rule's file."""

    model_config = ConfigDict(extra="forbid", strict=False)
    name: str
    criteria: tuple[Criterion, ...] | None = None
    limits: dict[str, tuple[_Number | None, _Number | None]] = {}

    @field_validator("criteria")
    @classmethod
    def _some(cls, value: tuple[Criterion, ...] | None) -> tuple[Criterion, ...] | None:
        if not value:
            raise ValueError("allowed: one or more [[criteria]]")
        return value

    @field_validator("limits")
    @classmethod
    def _known(cls, value: Mapping[str, tuple[float | None, float | None]]) -> object:
        names = [limit.name for limit in LIMITS]
        for name, bounds in value.items():
            if name not in names:
                raise ValueError(
                    f"'{name}' is not a limit; allowed: {', '.join(names)}{spelling_hint(name, names)}"
                )
            low, high = _bounds(bounds)
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}]: allowed: low below high, mmHg")
        return value

    def rule(self) -> Rule:
        """Convert to a rule."""
        limits = []
        for limit in LIMITS:
            low, high = _bounds(self.limits.get(limit.name, (limit.low, limit.high)))
            own = replace(limit, low=low, high=high, meaning=f"limit of {self.name}")
            limits.append(limit if (low, high) == (limit.low, limit.high) else own)
        return Rule(self.name, self.criteria or default_criteria(tuple(limits)), tuple(limits))


def _bounds(bounds: tuple[float | None, float | None]) -> tuple[float, float]:
    low, high = bounds
    return -math.inf if low is None else low, math.inf if high is None else high


def read_rule(source: str | Path | Mapping[str, object] | Rule | None) -> Rule:
    """Read a rule from its file or a mapping, or return a given rule; None gives the default one.

    Raises:
        RuleError: The rule cannot be read; the message has one line for each mistake.
    """
    if source is None or isinstance(source, Rule):
        return source or DEFAULT_RULE
    place, content = "rule", source
    if not isinstance(source, Mapping):
        place = str(source)
        try:
            content = {"name": Path(place).stem, **tomllib.loads(Path(place).read_text(encoding="utf-8"))}
        except FileNotFoundError:
            raise RuleError(f"{place}: no such file") from None
        except OSError as error:
            raise RuleError(f"{place}: cannot be read: {error.strerror or error}") from None
        except ValueError as error:
            raise RuleError(f"{place}: cannot be read as TOML: {error}") from None
    try:
        return _RuleFile.model_validate(content).rule()
    except ValidationError as refused:
        raise RuleError("\n".join(f"{place}: {_mistake(error)}" for error in refused.errors())) from None


def _mistake(error: Mapping[str, object]) -> str:
    """One line for an error reported by pydantic."""
    path = [str(word) for word in error["loc"]]  # pyright: ignore[reportGeneralTypeIssues]  # a tuple
    text = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        known = [f.name for f in fields(Criterion)] if "criteria" in path else list(_RuleFile.model_fields)
        text = f"unknown key; allowed: {', '.join(known)}{spelling_hint(path[-1], known)}"
    if path[:1] == ["limits"] and len(path) > 1:
        path, text = path[:2], "allowed: [low, high] in mmHg; inf or -inf for none"
    elif error["type"] == "missing":
        return f"{'.'.join(path[:-1]) or 'rule'}: {path[-1]} is missing"
    if error["type"] == "dataclass_type":
        text = "allowed: a table, [[criteria]] with quantity and a bound or prefer"
    return f"{'.'.join(path)} = {error['input']}: {text}" if path else text


def check_quantities(rule: Rule, known: Collection[str]) -> None:
    """Raise `RuleError` for quantities that a study does not have."""
    names = (*RULE_QUANTITIES, *known)
    lines = [
        f"{rule.name}: quantity = '{c.quantity}': not computed for this case; "
        f"allowed: {', '.join(RULE_QUANTITIES)}, any output of it{_advice(c.quantity, names)}"
        for c in rule.criteria
        if c.quantity not in names
    ]
    if lines:
        raise RuleError("\n".join(lines))


def _advice(name: str, names: Collection[str]) -> str:
    """What the case file lacks for an output, or the nearest spelling of a quantity."""
    needed = unavailable(name, [known for known in names if find_output(known) is not None])
    return needed if find_output(name) is not None else spelling_hint(name, names)
