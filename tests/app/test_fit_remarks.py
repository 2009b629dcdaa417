"""What a fit leaves open is said at the numbers of its patient, and not only before it was used."""

import pytest

from eclsim.app.beat import Beat, page_circuit
from eclsim.app.fit_remarks import judged_again, reason_of, remarks_of, with_remarks
from eclsim.app.fitting import judged
from eclsim.app.knobs import turn
from eclsim.app.provenance import provenance
from eclsim.app.state import (
    LONGEST_REMARK,
    MOST_REMARKS,
    FitRemark,
    History,
    PageState,
    Snapshot,
    link_of,
    packed,
    read_snapshot,
    state_of,
)
from eclsim.cases.presets import PRESETS
from eclsim.identification.verdict import Aspect
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.status import Status

CASE = PRESETS["healthy"].case()
BEAT = Beat(*page_circuit(CASE), 1.0, {}, {}, {"SP": 127.0, "CO": 3.5}, (), Status.CONVERGED, "")
VOLUME = "the blood volume is held at that of a published patient; measure CVP"


def cell(value: float, ends: tuple[float, float], determined: bool, measured: float | None = None) -> dict:
    return {
        "simulated": value, "lower": ends[0], "upper": ends[1], "determined": determined,
        "measured": measured,
    }  # fmt: skip


def fit(emaxlv: bool = False, volume: bool = True, **outputs: dict) -> dict:
    """As in a review: from MAP and CO alone, SP 127 (44 to 210) mmHg."""
    reasons = [{"level": "doubtful", "about": "", "sentence": "nothing is determined; measure more"}]
    reasons += [{"level": "good", "about": "fluid.extra_volume_ml", "sentence": VOLUME}] if volume else []
    return {
        "verdict": {"level": "doubtful", "reasons": reasons},
        "parameters": {"Emaxlv": {"identifiable": emaxlv}},
        "outputs": {"MAP": cell(65.0, (60.0, 70.0), True, 65.0), "CO": cell(3.5, (3.0, 4.0), True, 3.5)}
        | outputs,
    }


OPEN = {"SP": cell(126.6, (43.6, 209.5), False), "DP": cell(21.5, (-17.2, 61.2), False)}
STATE = PageState(CASE, origin="fit", verdict="doubtful", remarks=remarks_of(fit(**OPEN)), free=("Rmc",))


def test_the_numbers_of_a_fitted_patient_that_nothing_determines_are_marked_with_their_intervals():
    said = with_remarks(BEAT, STATE)
    sentences = {name: f.sentence for f in said.findings if f.kind == "caution" for name in f.concerns}
    assert "SP 127 (43.6 to 210 mmHg), DP 21.5 (\u221217.2 to 61.2 mmHg)" in sentences["SP"]
    assert sentences["SP"] == sentences["DP"] == sentences["pulse_pressure"]
    assert "Emaxlv" in sentences["ejection_fraction_lv"]
    assert "blood volume is held" in sentences["PCWP"]
    assert sentences["PCWP"] == sentences["right_atrial_pressure"] == sentences["EDVLV"]
    assert not sentences.keys() & {"MAP", "CO"}
    turned = STATE.with_case(turn(CASE, "patient.heart_rate_bpm", 91))
    later = with_remarks(BEAT, turned).findings
    assert all(f.sentence.startswith("At the fitted settings: ") for f in later if f.kind == "caution")
    assert with_remarks(BEAT, PageState(CASE)) == BEAT


def test_of_a_flow_that_is_open_all_that_is_of_it_is_marked():
    known = fit(True, False, CO=cell(0.82, (0.0, 11.5), False))
    names = {name for remark in remarks_of(known) for name in remark.outputs}
    assert {"CO", "LVO", "pulmonary_flow", "ejection_fraction_lv"} <= names
    assert [remark.outputs for remark in remarks_of(fit(True, False))] == [()]


def judged_as(*reasons: tuple[str, str, str]) -> dict:
    """A fit whose verdict has doubts of an aspect about an output each."""
    known = fit(True, False)
    more = [
        {"aspect": aspect, "level": "doubtful", "about": about, "sentence": sentence}
        for aspect, about, sentence in reasons
    ]
    return known | {"verdict": {"level": "doubtful", "reasons": [*known["verdict"]["reasons"], *more]}}


def test_what_is_implausible_in_a_fitted_patient_is_marked_with_all_that_depends_on_it():
    """Beside "do not use it, or anything that depends on it", EDVRV, RVEF and the RV's work stood bare."""
    volume = "end-diastolic volume of the right ventricle 12 mL, which is implausible: do not use it"
    known = judged_as((Aspect.PLAUSIBILITY, "EDVRV", volume), (Aspect.PLAUSIBILITY, "", "a limit is broken"))
    (remark,) = [remark for remark in remarks_of(known) if remark.outputs]
    assert volume in remark.sentence
    assert set(remark.outputs) == {
        "EDVRV", "ESVRV", "ejection_fraction_rv", "stroke_work_rv", "pressure_volume_area_rv",
    }  # fmt: skip
    state = PageState(CASE, origin="fit", verdict="doubtful", remarks=remarks_of(known))
    assert state_of(link_of(state)) == state
    names = ["EDVRV", "ESVLV", "MAP", "CO", "O2ER", "SPAP", "MPAP", "PCWP"]
    many = remarks_of(judged_as(*((Aspect.PLAUSIBILITY, name, f"{name} is implausible") for name in names)))
    assert {*names} <= {name for remark in many for name in remark.outputs}
    assert len(many) <= MOST_REMARKS


def test_a_measurement_that_a_fit_missed_is_marked_at_its_output():
    known = judged_as(
        (Aspect.AGREEMENT, "CVP", "CVP 12 fitted against 5 measured: 4.4 standard uncertainties off"),
        (Aspect.AGREEMENT, "ecmo.oxygenator.oxygen_transfer", "PpostO2 is above"),
        (Aspect.AGREEMENT, "", "no values of the free parameters were found"),
    )
    (remark,) = [remark for remark in remarks_of(known) if remark.outputs]
    assert remark.sentence.startswith("in the fit CVP 12 fitted against 5 measured")
    assert set(remark.outputs) == {"CVP", "right_atrial_pressure"}


def test_the_line_about_the_origin_says_why_a_fit_is_doubtful():
    assert "Fit: doubtful; nothing is determined." in provenance(STATE)["text"]
    turned = STATE.with_case(turn(CASE, "patient.heart_rate_bpm", 91))
    assert "nothing is determined." in provenance(turned)["text"]


def test_a_posterior_changes_the_first_reason_alone():
    known = fit() | {"parameters": {"Rmc": {"lower": 0.4, "upper": 0.6, "value": 0.5, "identifiable": True}}}
    known["verdict"]["goodness"] = None
    verdict = judged(known, {"Rmc": {"lower": 1.0, "upper": 2.0}})
    again = judged_again(STATE.remarks, verdict)
    assert again[0].sentence.startswith("Rmc: 90 % interval")
    assert again[1:] == STATE.remarks[1:]


def test_a_link_and_a_reloaded_tab_keep_what_a_fit_left_open():
    turned = STATE.with_case(turn(CASE, "patient.heart_rate_bpm", 91))
    for state in (STATE, turned):
        assert state_of(link_of(state)) == state
        assert reason_of(state_of(link_of(state))) == "nothing is determined"
    history = History(turned, past=[STATE])
    assert read_snapshot(Snapshot(history).packed()).history.past == [STATE]


@pytest.mark.parametrize(
    "remarks",
    [
        "no list", [["no outputs"]], [[1, []]], [["a", "SP"]], [["a", [1]]], [["a\n", []]],
        [["a" * (LONGEST_REMARK + 1), []]], [["a", []]] * (MOST_REMARKS + 1), {"a": []},
    ],
)  # fmt: skip
def test_no_other_remarks_come_in_by_a_link(remarks):
    plain = STATE.as_object() | {"remarks": remarks}
    with pytest.raises(CaseError, match="damaged"):
        state_of(packed({"v": 2, "state": plain}))
    assert all(isinstance(remark, FitRemark) for remark in STATE.remarks)


@pytest.mark.parametrize("free", ["Rmc", [1], ["a" * 300], ["Rmc"] * 100])
def test_no_other_names_of_fitted_parameters_come_in_by_a_link(free):
    with pytest.raises(CaseError, match="damaged"):
        state_of(packed({"v": 2, "state": STATE.as_object() | {"free": free}}))
