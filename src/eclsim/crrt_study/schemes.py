"""Ways to connect a CRRT circuit to an ECMO circuit, and requirements of the study on cases and options.

Nothing is simulated here, so input errors are reported at once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eclsim.arguments import number_of, written
from eclsim.cases.sections import POLICIES
from eclsim.devices.crrt import SCHEMES as CRRT_SCHEMES
from eclsim.devices.crrt import Crrt
from eclsim.devices.device import device_key
from eclsim.devices.ecmo import BEFORE_OXYGENATOR, BEHIND_OXYGENATOR, ECMO, POSITION_WORDS
from eclsim.devices.ecmo import POSITIONS as ECMO_POSITIONS
from eclsim.devices.ecmo_parts import PUMPS
from eclsim.devices.plausibility import check_speed
from eclsim.inputs.mistakes import Remarks
from eclsim.inputs.numbers import suspected_unit
from eclsim.patient.sites import (
    AFTER_LUNGS,
    BEFORE_LUNGS,
    PATIENT_SITES,
    SAME_IN_REGIONS,
    patient_sites,
)
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.cases.case import Case


@dataclass(frozen=True, slots=True)
class Scheme:
    """A scheme: the sites from which the CRRT draws blood and to which it returns it.

    Args:
        letter: key of the scheme, a to i for those of Figure 2 of Thiel et al., else "access:return".
        access_site: position in the ECMO circuit or compartment of the patient from which blood is drawn.
        return_site: position or compartment to which it is returned.
        note: special feature of the scheme.
        compartments: compartments that a patient's anatomy has at the two sites, if not those of their names.
    """

    letter: str
    access_site: str
    return_site: str
    note: str = ""
    compartments: tuple[str, str] | None = None

    @property
    def name(self) -> str:
        """The connection in words: access, then return."""
        return f"{site_words(self.access_site)} – {site_words(self.return_site)}"

    @property
    def nodes(self) -> tuple[str, str]:
        """Compartments of the circuit to which the two lines connect."""
        access, back = (ECMO_POSITIONS.get(site, site) for site in (self.access_site, self.return_site))
        return self.compartments or (access, back)

    def in_patient(self, divided: Mapping[str, str]) -> Scheme:
        """The scheme in a patient whose anatomy has other compartments at some sites."""
        access, back = (divided.get(node, node) for node in self.nodes)
        return self if (access, back) == self.nodes else replace(self, compartments=(access, back))

    @property
    def returns_behind_oxygenator(self) -> bool:
        """Whether returned blood passes no oxygenator, which would trap air or clots before the patient.

        A line to the left heart or an artery counts, one to a vein or the right heart does not: there the
        lungs follow.
        """
        return self.return_site in BEHIND_OXYGENATOR or self.returns_after_lungs

    @property
    def returns_after_lungs(self) -> bool:
        """Whether the return line ends in the patient's left heart or arteries."""
        return self.return_site in AFTER_LUNGS

    @property
    def past_oxygenator(self) -> bool:
        """Whether venous blood, from the patient or the circuit, bypasses the oxygenator through the CRRT."""
        venous = self.access_site in (*BEFORE_OXYGENATOR, *BEFORE_LUNGS)
        return self.returns_behind_oxygenator and venous

    @property
    def on_patient(self) -> bool:
        """Whether a line connects to the patient, where the model has no resistance of a catheter."""
        return not {self.access_site, self.return_site} <= ECMO_POSITIONS.keys()


def site_words(site: str) -> str:
    """Name of a site in words."""
    return POSITION_WORDS.get(site) or f"patient's {PATIENT_SITES[site]}"


FIGURE_2 = {letter: Scheme(letter, *sites) for letter, sites in CRRT_SCHEMES.items()}
"""The nine schemes as drawn in Figure 2 of Thiel et al. 2025."""

PUBLISHED = "published"
AS_DRAWN = "figure"
SCHEME_H = (PUBLISHED, AS_DRAWN)
"""Two versions of scheme h: in the published code and all numbers of the paper both lines are at pre pump;
in the figure the return line is at post drainage cannula."""

NINE = "all"
PAIRS = "pairs"
SEPARATE = "separate"
GROUPS = {
    NINE: "the nine schemes of Figure 2",
    PAIRS: "all 36 ordered pairs of positions",
    SEPARATE: "CRRT on the patient: svn:ra, svn:svn and ra:ra",
}
SEPARATE_PAIRS = (("svn", "ra"), ("svn", "svn"), ("ra", "ra"))


class SchemeError(ValueError):
    """Raised for a selection of schemes that cannot be read; the message says what is allowed."""


def nine_schemes(scheme_h: str = PUBLISHED) -> dict[str, Scheme]:
    """The nine schemes by letter, with h as in the published code or as in the figure."""
    if scheme_h not in SCHEME_H:
        raise SchemeError(f"scheme h '{scheme_h}'; allowed: {', '.join(SCHEME_H)}")
    schemes = dict(FIGURE_2)
    if scheme_h == PUBLISHED:
        schemes["h"] = replace(
            FIGURE_2["h"], return_site="pre_pump",
            note="both lines at pre pump, as in the published code; Figure 2 draws the return line at post "
            "drainage cannula",
        )  # fmt: skip
    return schemes


def select_schemes(selection: str | Sequence[str] = NINE, scheme_h: str = PUBLISHED) -> tuple[Scheme, ...]:
    """Return the schemes that a selection names, without repetition.

    Args:
        selection: letters a to i, groups (`all`, `pairs`, `separate`) and pairs `access:return`, as one text
            with commas or as a list.
        scheme_h: version of scheme h.

    Raises:
        SchemeError: Words cannot be read; the message names all of them.
    """
    if isinstance(selection, Mapping) or not isinstance(selection, Iterable):
        raise SchemeError(f"{written(selection)} is not a scheme; allowed: {_allowed()}")
    given = selection.split(",") if isinstance(selection, str) else list(selection)
    if wrong := [one for one in given if not isinstance(one, str)]:
        raise SchemeError(f"{written(wrong[0])} is not a scheme; allowed: {_allowed()}")
    names = [name.strip() for name in given if name.strip()]
    if not names:
        raise SchemeError(f"no schemes; allowed: {_allowed()}")
    nine = nine_schemes(scheme_h)
    chosen: dict[str, Scheme] = {}
    wrong = []
    for name in names:
        try:
            chosen.update({scheme.letter: scheme for scheme in _schemes_of_word(name, nine)})
        except SchemeError as error:
            wrong.append(str(error))
    if wrong:
        raise SchemeError("; ".join(wrong) + f"; allowed: {_allowed()}")
    return tuple(chosen.values())


def _allowed() -> str:
    groups = ", ".join(f"{name} ({meaning})" for name, meaning in GROUPS.items())
    positions = ", ".join(ECMO_POSITIONS)
    return f"letters a to i, {groups}, or access:return with {positions} or a patient's compartment"


def _schemes_of_word(word: str, nine: dict[str, Scheme]) -> list[Scheme]:
    if word in nine:
        return [nine[word]]
    if word == NINE:
        return list(nine.values())
    if word == PAIRS:
        return [_pair(access, to, nine) for access, to in itertools.product(ECMO_POSITIONS, repeat=2)]
    if word == SEPARATE:
        return [_pair(*sites, nine) for sites in SEPARATE_PAIRS]
    access_site, colon, return_site = word.partition(":")
    if not colon:
        raise SchemeError(_unknown(word, (*nine, *GROUPS)))
    known = (*ECMO_POSITIONS, *PATIENT_SITES)
    wrong = [_unknown(site, known) for site in (access_site, return_site) if site not in known]
    if wrong:
        raise SchemeError("; ".join(wrong))
    return [_pair(access_site, return_site, nine)]


def _pair(access_site: str, return_site: str, nine: dict[str, Scheme]) -> Scheme:
    """Return the scheme of a pair of sites, with its letter if it is one of the nine."""
    same = [s for s in nine.values() if (s.access_site, s.return_site) == (access_site, return_site)]
    return same[0] if same else Scheme(f"{access_site}:{return_site}", access_site, return_site)


def _unknown(word: str, known: Sequence[str]) -> str:
    return f"'{word[:40]}' is not a scheme{spelling_hint(word, known)}"


# --- requirements of the study on cases and options -------------------------------------------------


BOTH = "both"
DEFAULT_FLOW_ML_MIN = 200.0


class StudyError(ValueError):
    """Raised for a case or option that the study cannot use; the message says what is needed."""


def policies_of(volume_policy: str) -> tuple[str, ...]:
    """Return the policies that an option names."""
    if volume_policy == BOTH:
        return POLICIES
    if volume_policy not in POLICIES:
        raise StudyError(f"blood volume policy '{volume_policy}'; allowed: {', '.join((*POLICIES, BOTH))}")
    return (volume_policy,)


def policy_of_cases(cases: Sequence[Case]) -> str:
    """Return the policy that the cases of a cohort state, or both policies if none is stated.

    Raises:
        StudyError: The cases state different policies.
    """
    result = {case.blood_volume_policy or BOTH: case.patient.id for case in cases}
    if len(result) > 1:
        text = ", ".join(f"{policy} in {name}" for policy, name in result.items())
        raise StudyError(f"the cases state different blood volume policies ({text}); choose --volume-policy")
    return next(iter(result), BOTH)


def case_speed(case: Case) -> float:
    """Pump speed of a case, which the study requires [rpm]."""
    if case.ecmo is None:
        raise StudyError(
            f"case '{case.patient.id}' has no [ecmo] section: the study connects CRRT to an ECMO circuit"
        )
    if case.ecmo.speed_rpm is None:
        raise StudyError(
            f"case '{case.patient.id}' has a roller pump: the study varies the speed of a rotary pump"
        )
    if named := named_crrts(case):
        raise StudyError(
            f"case '{case.patient.id}' has [{'] and ['.join(named)}]: the study places one CRRT circuit; "
            "write [crrt], and leave others out"
        )
    return float(case.ecmo.speed_rpm)


def named_crrts(case: Case) -> list[str]:
    """Named CRRT sections such as "crrt.a", to which the study would add another CRRT circuit."""
    return [key for key in case.other_devices if device_key(key) == "crrt"]


def default_speeds(case: Case) -> tuple[float, ...]:
    """Default speeds over the usual range of the case's pump [rpm]."""
    assert case.ecmo is not None
    assert isinstance(case.ecmo.pump, str)
    low, high = PUMPS[case.ecmo.pump].speed_range_rpm
    return parse_speeds(f"{low:g}:{high:g}:{SPEED_STEP_RPM:g}")


def check_speeds(case: Case, speeds: Sequence[float]) -> None:
    """Raise an error for speeds that a case file could not have.

    Raises:
        StudyError: A speed is far above those of the case's pump.
    """
    if case.ecmo is None:
        return
    remarks = Remarks()
    check_speed(ECMO.key, {"pump": case.ecmo.pump, "speed_rpm": max(speeds)}, PUMPS, remarks)
    if remarks.mistakes:
        raise StudyError("; ".join(map(str, remarks.mistakes)))


def in_patient(case: Case, schemes: Sequence[Scheme]) -> tuple[Scheme, ...]:
    """Return the schemes with the compartments that the patient of a case has at their sites.

    Raises:
        StudyError: The patient does not have a site of a scheme.
    """
    from eclsim.cases.resolve import divided_sites

    regional = case.physiology is not None and case.physiology.regional
    own = {*ECMO_POSITIONS, *patient_sites(regional), *(SAME_IN_REGIONS if regional else ())}
    lacking = [s.letter for s in schemes if not {s.access_site, s.return_site} <= own]
    if lacking:
        raise StudyError(
            f"{', '.join(lacking)}: the patient of case '{case.patient.id}' has no such site; allowed: "
            f"{', '.join(patient_sites(regional))}"
            + ("" if regional else ", or add [physiology] regional = true")
        )
    return tuple(scheme.in_patient(divided_sites(case)) for scheme in schemes)


def check_flow(flow: float) -> None:
    """Raise an error for a CRRT flow [mL/min] outside the range allowed in a case file.

    Raises:
        StudyError: The flow is outside the range.
    """
    field = Crrt.fields()["flow_ml_min"]
    if not field.least <= flow <= field.maximum:  # a pump that stands still tells no schemes apart
        hint = suspected_unit(flow, field.unit, field.typical, (field.least, field.maximum))
        suggestion = f"; did you mean {hint}?" if hint else ""
        raise StudyError(
            f"CRRT flow {flow:g} mL/min; allowed: {field.least:g} to {field.maximum:g}{suggestion}"
        )


def crrt_flow(case: Case, requested: float | None) -> float:
    """Blood flow of the CRRT [mL/min]: the requested one, else the case's, else 200."""
    if requested is None:
        requested = DEFAULT_FLOW_ML_MIN if case.crrt is None else case.crrt.flow_ml_min
    requested = number_of("crrt_flow_ml_min", requested)
    check_flow(requested)
    return requested


# --- pump speeds -----------------------------------------------------------------------------------

MOST_SPEEDS = 1001
SPEED_STEP_RPM = 250.0


class SpeedError(ValueError):
    """Raised for speeds that cannot be read; the message says what is allowed."""


def parse_speeds(text: str) -> tuple[float, ...]:
    """Parse speeds [rpm] into ascending order, without repetition.

    Args:
        text: `first:last:step` with both ends included, or single speeds, separated by commas.

    Raises:
        SpeedError: A part of the text is no speed.
    """
    allowed = "first:last:step or single speeds [rpm] above 0, such as 1000:5000:250,3425"
    wrong = SpeedError(f"'{text[:60]}' are not speeds; allowed: {allowed}")
    speeds: set[float] = set()
    for part in text.split(","):
        try:
            numbers = [float(number) for number in part.split(":")]
        except ValueError:
            raise wrong from None
        if len(numbers) not in (1, 3) or not all(math.isfinite(n) and n > 0.0 for n in numbers):
            raise wrong
        first, last, step = numbers if len(numbers) == 3 else (*numbers, *numbers, 1.0)
        count = (last - first) / step
        if not 0.0 <= count <= MOST_SPEEDS:
            raise wrong
        speeds.update(first + k * step for k in range(math.floor(count + 1e-9) + 1))
    if len(speeds) > MOST_SPEEDS:
        raise SpeedError(f"'{text[:60]}': {len(speeds)} speeds; allowed: up to {MOST_SPEEDS}")
    return tuple(sorted(speeds))
