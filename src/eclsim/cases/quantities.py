"""Numbers of a case by name, as studies vary and fit them: their meaning and their place in a case.

A number is a parameter of the tables, stored in [parameters], or a key of another section, such as
`gas.shunt_fraction`, `ecmo.speed_rpm` or `lvad.left.speed_rpm`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Sized
from typing import TYPE_CHECKING

from eclsim.arguments import written
from eclsim.cases.fluid import Fluid, base_excess_of_bicarbonate
from eclsim.cases.sections import Patient, is_instance_name, section_of
from eclsim.devices.dialysed_blood import HAEMOGLOBIN
from eclsim.devices.registry import devices, parameters
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.inputs.numbers import is_number
from eclsim.inputs.sections import Section
from eclsim.parameters import thiel2025
from eclsim.parameters.parameter import Parameter
from eclsim.spelling import did_you_mean

if TYPE_CHECKING:
    from eclsim.cases.case import Case


PARAMETERS = "parameters"
HEART_RATE = "heart_rate_bpm"


def section_and_key(name: str) -> tuple[str, str] | None:
    """Return section and key of a number, such as ("lvad.left", "speed_rpm"); None if no case contains it."""
    if name == HEART_RATE:
        return Patient.section, name
    section, _, key = name.rpartition(".")
    belongs = section_of(section)
    instance = section.partition(".")[2]
    if belongs is not None and key in belongs.fields() and (not instance or is_instance_name(instance)):
        return section, key
    key = name.removeprefix(f"{PARAMETERS}.")
    key = thiel2025.ALIASES.get(key, key)
    return (PARAMETERS, key) if _in_tables(key) is not None else None


def quantity(name: str) -> Parameter | None:
    """Return unit, meaning and allowed range of a number of a case; None if there is no such number.

    Args:
        name: name of a parameter or key, also of a named instance (`ecmo.left.Recmooxy`).
    """
    if (known := _in_tables(name)) is not None:
        return known
    if (field := numeric_field(name)) is None:
        return None
    return Parameter(
        name, field.typical, field.unit, field.description, "a case's own", field.minimum, field.maximum,
        place[0] if (place := section_and_key(name)) else "",
    )  # fmt: skip


def numeric_field(name: str) -> Field | None:
    """Return the key of a section that contains a number; None for one of the tables, and for no number."""
    place = section_and_key(name)
    kind = None if place is None else section_of(place[0])
    field = None if place is None or kind is None else kind.fields()[place[1]]
    return field if field is not None and field.kind == "number" else None


def _in_tables(name: str) -> Parameter | None:
    """Return the parameter with a name; the name of an instance's parameter gives that of its device."""
    known, (device, _, remainder) = parameters(), name.partition(".")
    instance, _, key = remainder.partition(".")
    names = (f"{device}.{key}", key) if key and device in devices() and is_instance_name(instance) else ()
    return next((known[each] for each in (name, *names) if each in known), None)


def stated(case: Case, name: str) -> float | None:
    """Return the value that a case itself gives to a number; None if the default applies."""
    place = section_and_key(name)
    if place is None:
        return None
    value = case.parameters.get(place[1]) if place[0] == PARAMETERS else case.setting(*place)
    return float(value) if is_number(value) else None


def with_values(case: Case, values: Mapping[str, float]) -> Case:
    """Return the case with new values of some numbers, each stored where a case file has it.

    A base excess that the case leaves to its bicarbonate stays the one at its own haemoglobin, as in the
    beats in which haemoglobin varied.

    Args:
        case: case that has the sections of these numbers; only [fluid] is added if missing.
        values: values by name, within their allowed ranges.

    Raises:
        ValueError: No case contains the number, or this case lacks its section.
    """
    changes: dict[str, dict[str, float]] = {}
    held = base_excess_of_bicarbonate(case) if HAEMOGLOBIN in values else {}
    for name, value in {**held, **values}.items():
        place = section_and_key(name)
        if place is None:
            raise ValueError(f"{name}: not a numeric quantity of a case")
        changes.setdefault(place[0], {})[place[1]] = value
    for section, section_values in changes.items():
        current = getattr(case, section, None)
        if section == PARAMETERS:
            case = case.model_copy(update={section: {**case.parameters, **section_values}})
        elif case.instance(section) is not None:
            case = case.with_section(section, **section_values)
        elif isinstance(current, Section):
            case = case.model_copy(update={section: current.model_copy(update=section_values)})
        elif section == Fluid.section:
            case = case.model_copy(update={section: Fluid().model_copy(update=section_values)})
        else:
            raise ValueError(f"{', '.join(section_values)}: the case has no [{section}] section")
    return case


# --- samples of parameters ------------------------------------------------------------------------


def as_samples(samples: Mapping[str, Sequence[float]]) -> Mapping[str, Sequence[float]]:
    """Check that samples are lists of numbers by parameter, and return them.

    Raises:
        TypeError: They are not.
    """
    allowed = 'lists of numbers by parameter, such as {"Rmc": [0.8, 0.9]}'
    if not isinstance(samples, Mapping):
        raise TypeError(f"samples: {written(samples)} names no parameter; allowed: {allowed}")
    for name, values in samples.items():
        if isinstance(values, str) or not (isinstance(values, Iterable) and isinstance(values, Sized)):
            raise TypeError(f"samples of {name}: {written(values)}; allowed: {allowed}")
        if wrong := [one for one in values if isinstance(one, str) or not hasattr(one, "__float__")]:
            raise TypeError(f"samples of {name}: {written(wrong[0])} is not a number; allowed: {allowed}")
    return samples


def check_samples(samples: Mapping[str, Sequence[float]], known: Collection[str]) -> None:
    """Refuse samples of unequal length, out of range, or of parameters that the study does not read.

    Args:
        samples: values of each parameter, in its unit, one per sample.
        known: names of the parameters that the study reads.

    Raises:
        CaseError: There are such samples; all are listed.
    """
    if mistakes := list(_mistakes(samples, known)):
        raise CaseError(mistakes)


def _mistakes(samples: Mapping[str, Sequence[float]], known: Collection[str]) -> Iterator[Mistake]:
    counts = {name: len(values) for name, values in samples.items()}
    if len({*counts.values()}) != 1 or 0 in counts.values():
        text = ", ".join(f"{name} {count}" for name, count in counts.items())
        yield Mistake("samples", "numbers of samples", text, "the same for every parameter, at least one")
    for name, values in samples.items():
        if name not in known:
            message = "not a parameter that this study uses"
            yield Mistake(name, message, suggestion=did_you_mean(name, known))
            continue
        parameter = quantity(name)
        for number, value in enumerate(map(float, values), start=1):
            if not math.isfinite(value) or (parameter is not None and not parameter.accepts(value)):
                allowed = "finite numbers" if parameter is None else parameter.allowed
                yield Mistake(name, f"sample {number} is out of range", f"{value:g}", allowed)
                break
