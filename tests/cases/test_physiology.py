"""The section [physiology]: what it takes, refuses and passes on."""

import pytest

from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping, write_case
from eclsim.cases.resolve import anatomy_of, circuit_of, resolve_parameters, switched_circuit
from eclsim.circuit import Circuit

PATIENT = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 80}
VV = {"pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VV"}
CRRT = {"flow_ml_min": 200, "access_site": "svn", "return_site": "ra"}


def read(physiology, **sections):
    return read_mapping({"format": 1, "patient": PATIENT, "physiology": physiology} | sections)


@pytest.mark.parametrize(
    ("physiology", "sections", "line"),
    [
        ({"regional": True, "upper_share": 35}, {},
         "physiology.upper_share = 35: outside the allowed range; allowed: 0.1 to 0.6, a fraction, not a "
         "percentage"),
        ({"bronchial_fraction": 1.5}, {},
         "physiology.bronchial_fraction = 1.5: outside the allowed range; allowed: 0 to 0.3, a fraction, "
         "not a percentage"),
        ({"regional": "true"}, {},
         'physiology.regional = "true": true or false belongs here, without quotes; allowed: true, false; '
         "did you mean true?"),
        ({"regionale": True}, {}, "physiology.regionale = true: unknown key; allowed: regional, upper"),
        ({"pericardum": True}, {}, "physiology.pericardum = true: unknown key; allowed: regional, "),
        ({"pericardium": 1}, {}, "physiology.pericardium = 1: true or false belongs here, without quotes; "),
        ({"collapsible_veins": "yes"}, {},
         'physiology.collapsible_veins = "yes": true or false belongs here, without quotes; allowed: true, '),
        ({"collapsible_veins": True}, {"parameters": {"caval_collapse_mmHg": 5.0}},
         "parameters.caval_collapse_mmHg = 5: outside the allowed range; allowed: -15 to 0 mmHg"),
        ({"aortic_stenosis_cm2": 80}, {},
         "physiology.aortic_stenosis_cm2 = 80: outside the allowed range; allowed: 0.1 to 15 cm2"),
        ({}, {"crrt": CRRT | {"access_site": "lower"}},
         'crrt.access_site = "lower": a site of a patient with regions; allowed: ao, sart, svn, ra, rv, pas, '
         "part, pvn, la, lv, or add [physiology] regional = true"),
        ({"regional": True}, {"crrt": CRRT | {"access_site": "lowr"}},
         'crrt.access_site = "lowr": unknown name; allowed: '),
        ({}, {"parameters": {"physiology.upper_share": 0.3}},
         "parameters.physiology.upper_share = 0.3: is set in the section [physiology], not here; allowed: "
         "upper_share in [physiology]; did you mean physiology.upper_share?"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(physiology, sections, line):
    with pytest.raises(CaseError) as caught:
        read(physiology, **sections)
    assert len(caught.value.mistakes) == 1
    assert str(caught.value).startswith(line)


def test_misspelt_sites_of_regions_have_a_nearest_spelling():
    with pytest.raises(CaseError, match="did you mean lower"):
        read({"regional": True}, crrt=CRRT | {"access_site": "lowr"})


def test_vessels_that_are_divided_stand_for_a_part_of_them_and_a_note_says_which():
    reading = read({"regional": True}, ecmo=VV, crrt=CRRT)
    notes = {note.key: str(note) for note in reading.notes}
    assert 'read as "ivc"' in notes["ecmo.drainage_site"]
    assert 'read as "ivc"' in notes["crrt.access_site"]
    for circuit in (circuit_of(reading.case), switched_circuit(reading.case)[0]):
        assert circuit.connection("ecmodrain").source == circuit.connection("crrttuin").source == "ivc"
    assert {"upper", "svc"} <= set(reading.case.sites())
    assert "svn" not in reading.case.sites()


def test_what_has_no_effect_is_said():
    warned = [str(w) for w in read({"upper_share": 0.3}, parameters={"svc_vessel_share": 0.3}).warnings]
    assert len(warned) == 2
    assert all("without effect: the patient has no regions" in text for text in warned)
    own = {"caval_rest_volume_ml": 100.0, "pericardium_ml": 400.0}
    veins, pericardium = [str(w) for w in read({}, parameters=own).warnings]
    assert "no veins that collapse; add [physiology] collapsible_veins = true" in veins
    assert "no pericardium; add [physiology] pericardium = true" in pericardium
    assert not read({"collapsible_veins": True, "pericardium": True}, parameters=own).warnings


def test_a_case_is_written_and_read_back(tmp_path):
    from eclsim.cases import read_case

    own = {"regional": True, "upper_share": 0.3, "mitral_regurgitation_cm2": 0.2, "aortic_stenosis_cm2": 1.1}
    case = read(own, ecmo=VV).case
    write_case(case, tmp_path / "case.toml")
    assert read_case(tmp_path / "case.toml").case == case


def test_sections_choose_the_anatomy_and_its_values():
    own = {"bronchial_fraction": 0.02, "mitral_regurgitation_cm2": 0.2, "aortic_stenosis_cm2": 1.1}
    case = read(own).case
    anatomy = anatomy_of(case)
    assert (anatomy.regional, anatomy.bronchial) == (False, True)
    assert (set(anatomy.regurgitant), set(anatomy.stenosed)) == ({"mitral"}, {"aortic"})
    circuit: Circuit = circuit_of(case)
    assert set(circuit.parameter_names()) <= set(resolve_parameters(case))
    assert resolve_parameters(case)["physiology.aortic_stenosis_cm2"] == 1.1
    assert "CQao" not in circuit.parameter_names()
