"""What a CRRT study assumes, in sentences for its page and its JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

from eclsim.cases.regulation import GAS_RESPONSES
from eclsim.devices.ecmo import POSITIONS
from eclsim.orbit.model import AS_PUBLISHED, POLICY_WORDS
from eclsim.parameters import physiology
from eclsim.parameters.regulation import DRUG_DOSES, GAIN, REGULATION
from eclsim.parameters.regulation import PARAMETERS as REGULATED

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.crrt_study.study import CrrtStudy


def assumptions_in_words(study: CrrtStudy) -> list[str]:
    """All assumptions of a study, one sentence each, without full stops at their ends."""
    patient, nodes = study.case.patient, {node for scheme in study.schemes for node in scheme.nodes}
    sentences = [
        model_in_words(study.case),
        f"The CRRT pump gives {study.crrt_flow_ml_min:g} mL/min whatever the pressures are",
        "Where the rule sets no others, alarm limits are usual settings of CRRT machines; the limit of 190 "
        "mmHg is from Sansom et al. 2023; the drainage limit is a convention",
        *(f"{sentence[0].upper()}{sentence[1:]}" for sentence in study.assumed),
        "Flows at limits are interpolated between the speeds studied",
        "Blood that recirculates from the return to the access line is counted with complete mixing in each "
        "part of the ECMO circuit",
        *(f"Blood volume, {words}" for policy, words in POLICY_WORDS.items() if policy in study.policies),
    ]
    if not nodes <= set(POSITIONS.values()):
        sentences.append("Lines on the patient attach without a catheter and its resistance")
    if patient.height_cm is None or patient.weight_kg is None:
        sentences.append("Height and weight were not given: means for sex and age set the blood volume")
    if AS_PUBLISHED not in study.policies:
        sentences.append(
            "The published volume policy was not studied, so effects are not split into volume and flow"
        )
    return sentences


def model_in_words(case: Case) -> str:
    """The model of a patient in one sentence: reflexes, drugs, regions, extensions, gases and fluid."""
    gas = [] if case.gas else ["no gas exchange"]
    parts = [_reflexes(case), _drugs(case), *_physiology(case), *gas, *_blood_given(case)]
    parts.append("no fluid taken from the blood volume by the CRRT")
    return f"The steady heartbeat of the cardiovascular model of Thiel et al. 2025; {', '.join(parts)}"


def models_in_words(cases: Mapping[str, Case]) -> list[str]:
    """Models of the patients of a cohort; if they differ, each with its number of data points."""
    count = Counter(map(model_in_words, cases.values()))
    if len(count) == 1:
        return list(count)
    return [
        f"In {number} of {len(cases)} data points: {sentence}" for sentence, number in count.most_common()
    ]


def _reflexes(case: Case) -> str:
    """Reflexes that act; those that respond to gases need them."""
    settings = {} if case.regulation is None else case.regulation.values()
    acting = [
        f"{REGULATED[key].description.partition(':')[0]} {settings[key]:g}"
        for key in (GAIN, *(f"{REGULATION}.{name}" for name in GAS_RESPONSES if case.gas))
        if settings.get(key)
    ]
    if not acting or case.regulation is None:
        return "no reflexes"
    return f"reflexes ({case.regulation.model}: {', '.join(text[0].lower() + text[1:] for text in acting)})"


def _drugs(case: Case) -> str:
    doses = {} if case.drugs is None else {name: getattr(case.drugs, name) for name in DRUG_DOSES}
    infused = [f"{name} {dose:g} {DRUG_DOSES[name].unit}" for name, dose in doses.items() if dose]
    return f"infusions of {', '.join(infused)}" if infused else "no drugs"


def _physiology(case: Case) -> list[str]:
    """Regions, and the extensions of heart and vessels that are on."""
    section = case.physiology
    if section is None:
        return ["all organs as one bed"]
    areas = {
        f"{p.description[0].lower()}{p.description[1:]} {value:g} {p.unit}"
        for key, value in section.values().items()
        if key.endswith("_cm2") and value and (p := physiology.PARAMETERS[key])
    }
    return [
        "upper and lower body as regions" if section.regional else "all organs as one bed",
        *(["bronchial circulation"] if section.bronchial_fraction else []),
        *(["a vena cava that collapses"] if section.collapsible_veins else []),
        *(["a pericardium"] if section.pericardium else []),
        *sorted(areas),
    ]


def _blood_given(case: Case) -> list[str]:
    volume = 0.0 if case.fluid is None else case.fluid.extra_volume_ml
    if not volume:
        return []
    return [f"{abs(volume):g} mL of blood {'given' if volume > 0.0 else 'lost'} before"]
