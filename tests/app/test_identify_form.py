"""The form of measurements, and a fit that can be cancelled and never runs twice."""

import asyncio
import re
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from eclsim.app import identify
from eclsim.app.fitting import FitError, judged, prepared_for_fit
from eclsim.app.identify import Identification, checked_form, fields, values_of
from eclsim.app.knobs import LUNGS_WITHOUT_ECMO, connect, turn
from eclsim.app.provenance import circuit_text, fitted_case, fitted_with, provenance
from eclsim.app.state import PageState, link_of, preset_state, state_of, subject_of
from eclsim.app.texts import in_page_words
from eclsim.app.updates import PosteriorBands
from eclsim.cases.case import Measurements
from eclsim.cases.presets import PRESETS
from eclsim.cases.quantities import stated, with_values
from eclsim.cases.reading import read_case
from eclsim.identification.verdict import (
    Aspect,
    FitVerdict,
    Goodness,
    Level,
    Reason,
    agreement,
    interval_agreement,
)
from patience import PATIENCE_S, until

CASE = PRESETS["paper"].case()
EXAMPLE = Path(__file__).parents[2] / "examples" / "veno_venous_blood_gases.toml"
MEASURED = {"SP": "83", "DP": "76", "MAP": "80", "MPAP": "11", "CO": "1.4", "PF": "3.5"}


def form(**changes: object) -> dict[str, object]:
    typed = values_of(PageState(CASE)) | {f"measurements.{k}": v for k, v in MEASURED.items()}
    return typed | {k.replace("__", "."): v for k, v in changes.items()}


def test_the_form_has_a_value_for_every_field():
    assert {f["key"] for f in fields()} == set(values_of(PageState(CASE)))


def test_only_what_was_measured_is_filled_in():
    """What the model gives is no measurement, and a preset is nobody who was measured."""
    values = values_of(preset_state("paper"))
    assert values["patient.id"] == ""
    assert values["patient.age_years"] == 70
    assert {v for k, v in values.items() if k.startswith("measurements")} == {""}
    measured = CASE.model_copy(update={"measurements": Measurements(MAP=71.0)})
    filled = values_of(PageState(measured, origin="file"))
    assert filled["measurements.MAP"] == 71.0
    assert filled["measurements.SP"] == ""
    assert filled["patient.id"] == CASE.patient.id
    person = CASE.patient.model_copy(update={"id": f"{CASE.patient.id} (changed)"})
    changed = PageState(CASE.model_copy(update={"patient": person}), origin="file")
    assert values_of(changed)["patient.id"] == CASE.patient.id, "what is fitted anew is not changed by hand"


def test_what_the_form_has_of_a_preset_is_called_so():
    sent = []
    for state in (preset_state("paper"), PageState(CASE, origin="file")):
        session = SimpleNamespace(state=state)
        Identification(session, lambda topic, data: sent.append((topic, data)), None, None).follow()
    assert [data["preset"] for topic, data in sent if topic == "form"] == [True, False]


def test_a_good_form_is_a_case_with_the_devices_of_the_page():
    checked = checked_form(CASE, form())
    assert not checked.mistakes
    assert checked.values["measurements"]["SP"] == 83
    assert checked.values["ecmo"]["speed_rpm"] == 3425


@pytest.mark.parametrize("preset", PRESETS)
def test_nobody_is_fitted_from_the_heart_and_vessels_of_a_preset(preset):
    state = preset_state(preset)
    turned = state.with_case(turn(turn(state.case, "volume_ml", 400), "parameters.Csart", 0.9))
    for one in (state, turned):
        case = fitted_case(one)
        assert {name for name in case.parameters if "." not in name} == set()
        assert case.instances() == state.case.instances()
        assert fitted_with(one) == circuit_text(state.case)


def test_what_clots_in_a_device_of_a_preset_stays_in_the_fit_and_is_named():
    state = preset_state("paper")
    clotted = turn(turn(state.case, "parameters.Recmooxy", 3.0), "parameters.Rcrrtfil", 40.0)
    turned = state.with_case(clotted)
    assert dict(fitted_case(turned).parameters) == {"Recmooxy": 3.0, "Rcrrtfil": 40.0}
    assert all(part in fitted_with(turned) for part in ("Recmooxy 3", "Rcrrtfil 40"))


def test_what_is_held_in_a_fit_is_named_with_it():
    parameters = {"P0svn": 20.0, "RV_Pd_kappa": 0.025, "Emaxlv": 0.9}
    case = connect(CASE.model_copy(update={"parameters": parameters}), "gas")
    file = PageState(turn(case, "gas.fio2", 0.8), "patient_held", origin="file")
    assert fitted_case(file) == file.case
    words = fitted_with(file)
    for part in ("Rotaflow", "fio2 0.8", "Extra blood volume", "RV_Pd_kappa 0.025", "primed"):
        assert part in words
    assert "Emaxlv" not in words, "it is fitted"
    fitted = PageState(file.case, origin="fit", verdict="good")
    assert "RV_Pd_kappa 0.025" in provenance(fitted)["text"]
    assert provenance(file)["circuit"] == words, "a change of any of it makes a fit an older one"


@pytest.mark.parametrize(
    ("preset", "value", "said"),
    [
        ("paper", None, "shunt 0.4, assumed unless it is fitted"),
        ("healthy", None, "shunt 0.05, assumed unless it is fitted"),
        ("paper", 0.3, "shunt_fraction 0.3"),
    ],
)
def test_a_shunt_that_the_page_assumed_is_named_with_the_fit(preset, value, said):
    """Nobody had given it: it was not named where it is that of a case file, and looked given where not."""
    case = connect(PRESETS[preset].case(), "gas")
    words = fitted_with(PageState(case if value is None else turn(case, "gas.shunt_fraction", value)))
    assert said in words
    assert words.count("shunt") == 1


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({"measurements__SP": "70"}, "measurements.SP", "below diastolic"),
        ({"measurements__SP": "1,200"}, "measurements.SP", "1,200 may mean 1.200 or 1200"),
        ({"measurements__SP": "120/80"}, "measurements.SP", "two pressures"),
        ({"measurements__CO": "3400"}, "measurements.CO", "mL/min"),
        ({"measurements__MAP": "15 cmH2O"}, "measurements.MAP", "mmHg"),
        ({"measurements__MAP": "300"}, "measurements.MAP", "range"),
        ({"patient__heart_rate_bpm": "1.2"}, "patient.heart_rate_bpm", "range"),
        ({"patient__heart_rate_bpm": ""}, "patient.heart_rate_bpm", "missing"),
        ({"patient__age_years": "70 y"}, "patient.age_years", ""),
        ({"patient__age_years": "3"}, "patient.age_years", "range"),
        ({"patient__id": ""}, "patient.id", ""),
        ({"measurements__SP": "1e400"}, "measurements.SP", "too large"),
        ({"measurements__SP": ["a"], "patient__sex": "other"}, "patient.sex", ""),
    ],
)
def test_bad_values_are_said_at_their_field(changes, key, message):
    mistakes = checked_form(CASE, form(**changes)).mistakes
    assert any(m.key == key and message in str(m) for m in mistakes), [str(m) for m in mistakes]


def test_a_decimal_comma_is_read_as_a_point():
    checked = checked_form(CASE, form(measurements__CO="1,4", measurements__SP="83,5"))
    assert not checked.mistakes
    assert (checked.values["measurements"]["CO"], checked.values["measurements"]["SP"]) == (1.4, 83.5)


def test_doubts_do_not_stop_a_fit():
    checked = checked_form(CASE, form(patient__id="Meier, Hans"))
    assert not checked.mistakes
    assert any(m.key == "patient.id" for m in checked.warnings)


def test_missing_values_are_left_out_and_an_empty_form_is_refused():
    some = checked_form(CASE, form(measurements__PCWP="n/a", measurements__CO=""))
    assert "PCWP" not in some.values["measurements"]
    none = checked_form(CASE, {k: v for k, v in form().items() if not k.startswith("measurements")})
    assert any("nothing to fit" in str(m) for m in none.mistakes)


class StubSession:
    def __init__(self):
        self.state = PageState(CASE)
        self.beat = None
        self.loaded = []
        self.shown = None
        self.closed = False
        self.view = "identify"

    def load(self, state):
        self.loaded.append(state)

    def send(self, topic, data):
        pass

    def judge(self, old, new):
        self.judged = old, new


class StubFitter:
    """A fit that goes on until it may end."""

    def __init__(self):
        self.may_end, self.running, self.answer = threading.Event(), [], {"usable": True}

    def prepare(self):
        pass

    def run(self, job, case, policy, report, stop, free=()):
        self.running.append(case)
        self.free = tuple(free)
        report("draws")
        self.may_end.wait(2 * PATIENCE_S)
        if isinstance(self.answer, Exception):
            raise self.answer
        if job == "fit":
            return {"case": case} | self.answer
        return {
            "names": ["Rmc"], "members": [[0.8], [1.0]], "method": "importance", "doubts": [], "draws": 2,
            "parameters": {"Rmc": {"lower": 0.74, "median": 0.8, "upper": 0.92}},
        }  # fmt: skip


@pytest.fixture
def slow() -> StubFitter:
    return StubFitter()


def messages_of(fitter, action) -> list:
    messages: list = []
    tell = lambda topic, data: messages.append((topic, data))  # noqa: E731
    session = StubSession()
    bands = PosteriorBands(None, session)  # type: ignore[arg-type]
    asyncio.run(action(Identification(session, tell, fitter, bands), messages))  # type: ignore[arg-type]
    return messages


def last_message_of(messages) -> tuple[str, str]:
    topic, data = messages[-1]
    assert data["subject"] == subject_of(PageState(CASE))
    return topic, data["message"]


def test_another_patient_has_another_form_no_results_and_no_fit_that_runs(slow):
    async def action(one, messages):
        one.fill()
        fit = asyncio.create_task(one.start(form()))
        await until(lambda: slow.running)
        first, other = one.session.state, PageState(PRESETS["lvad"].case())
        one.session.state = other
        one.follow()
        assert not one.running
        await fit
        assert not one.use()
        one.session.state = other.with_case(turn(other.case, "patient.heart_rate_bpm", 77))
        one.follow()  # the same patient: the form stays
        one.session.state = first
        one.follow()
        slow.may_end.set()

    messages = messages_of(slow, action)
    forms = [data for topic, data in messages if topic == "form"]
    assert [f["values"]["patient.id"] for f in forms] == [CASE.patient.id, "LVAD", CASE.patient.id]
    assert len({f["subject"] for f in forms}) == 2


def test_a_fit_that_the_browser_kept_is_used_by_a_server_that_does_not_know_it(slow):
    slow.may_end.set()
    fit = {}

    async def first(one, messages):
        await one.start(form())
        fit.update(next(data["fit"] for topic, data in messages if topic == "fit_ended"))

    async def second(one, messages):
        assert not one.use("")
        assert not one.use("nonsense")
        assert not one.use(link_of(PageState(PRESETS["lvad"].case(), origin="fit")))  # another patient's
        assert one.use(fit["link"])
        assert one.session.loaded[0].case == state_of(fit["link"]).case

    messages_of(slow, first)
    messages_of(slow, second)
    assert "3425 rpm" in fit["of"]
    assert CASE.patient.id in fit["of"]


FREED = {"gas.shunt_fraction": 0.684086732662, "gas.vo2_ml_min": 342.573462433, "Rcrrtfil": 61.2, "Rmc": 0.55}


def with_gases_fitted():
    """A V-V patient whose consumption, shunt and filter a fit found, as used and before."""
    case = connect(PRESETS["paper"].case(), "gas").model_copy(update={"parameters": {}})
    fitted = with_values(case, FREED | {"fluid.extra_volume_ml": 888.16})
    names = (*FREED, "fluid.extra_volume_ml")
    return PageState(case, origin="file"), PageState(fitted, origin="fit", verdict="good", free=names)


def test_what_a_fit_found_is_no_setting_of_the_next_one():
    """342.573462433 mL/min were listed as set, and the next fit took them for known."""
    before, used = with_gases_fitted()
    for words in (fitted_with(used), provenance(used)["text"]):
        assert not re.search(r"342\.|0\.68|888|61\.2|vo2|Rcrrtfil", words)
    assert fitted_case(used).gas == before.case.gas
    assert not fitted_case(used).parameters
    assert all(stated(used.case, name) == value for name, value in FREED.items()), "the patient keeps them"
    turned = used.with_case(turn(used.case, "gas.vo2_ml_min", 250.0))
    assert "vo2_ml_min 250" in fitted_with(turned), "the user's own"
    assert fitted_case(turned).gas.vo2_ml_min == 250.0
    exact = used.with_case(turn(used.case, "gas.temperature_c", 36.123456))
    assert "temperature_c 36.12" in fitted_with(exact)
    assert "36.123" not in fitted_with(exact)


def test_a_patient_in_use_does_not_make_its_own_fit_an_older_one(slow):
    """ "The settings were changed after this fit: press Fit" stood there as soon as the patient was used."""
    slow.may_end.set()
    before, used = with_gases_fitted()
    slow.answer = {
        "usable": True, "case": used.case.as_mapping(), "parameters": {key: {} for key in used.free},
    }  # fmt: skip

    async def action(one, messages):
        one.session.state = before
        typed = values_of(before) | {"measurements.CVP": "12"}
        await one.start(typed)
        assert one.use()
        (fitted,) = one.session.loaded
        assert set(fitted.free) == set(used.free)
        known = next(data["fit"] for topic, data in messages if topic == "fit_ended")["settings"]
        for state in (before, fitted):
            assert provenance(state)["circuit"] in known
        for key, value in (("ecmo.speed_rpm", 3000.0), ("gas.vo2_ml_min", 250.0)):
            assert provenance(fitted.with_case(turn(fitted.case, key, value)))["circuit"] not in known

    messages_of(slow, action)


def test_a_posterior_that_excludes_the_interval_of_the_fit_makes_it_a_poor_one(slow):
    """Gaussian 0.46 to 0.66 beside a posterior of 0.74 to 0.92 must not pass without a word."""
    slow.may_end.set()
    known = {"value": 0.55, "lower": 0.46, "upper": 0.66, "identifiable": True, "reason": ""}
    verdict = FitVerdict(None, ()).as_object()
    slow.answer = {"usable": True, "parameters": {"Rmc": known}, "verdict": verdict}

    async def action(one, messages):
        await one.start(form())
        assert one.use()
        fitted = one.session.state = one.session.loaded[0].with_case(
            CASE.model_copy(update={"parameters": {"Rmc": 0.55}})
        )
        one._fitted = {subject_of(fitted): fitted}
        assert fitted.verdict == "good"
        await one.compute_posterior()
        old, new = one.session.judged
        assert (old.verdict, new.verdict) == ("good", "poor")
        assert one._fitted[subject_of(fitted)].verdict == "poor"

    topic, data = messages_of(slow, action)[-1]
    assert topic == "posterior_ended"
    assert data["judged"]["verdict"]["level"] == "poor"
    assert "POOR FIT" in data["judged"]["headline"]
    assert not data["judged"]["parameters"]["Rmc"]["identifiable"]


def test_a_double_press_is_one_fit_and_it_can_be_used(slow):
    async def action(one, messages):
        first = asyncio.create_task(one.start(form()))
        await until(lambda: slow.running)
        await one.start(form())
        slow.may_end.set()
        await first
        assert one.use()
        (fitted,) = one.session.loaded
        assert fitted.origin == "fit"
        assert subject_of(fitted) == subject_of(one.session.state)  # whose measurements they were

    messages = messages_of(slow, action)
    assert len(slow.running) == 1
    assert [t for t, _ in messages].count("fit_ended") == 1
    assert any(t == "fit_progress" for t, _ in messages)


def test_the_posterior_belongs_to_the_fitted_patient(slow):
    slow.may_end.set()

    async def action(one, messages):
        await one.compute_posterior()
        assert slow.running == []  # nothing is fitted yet
        typed = form()
        await one.start(typed)
        (subject, fit) = next(iter(one._fitted.items()))
        one._fitted[subject] = replace(fit, case=fit.case.model_copy(update={"parameters": {"Rmc": 0.9}}))
        one._fits[subject] = {"parameters": {"Rmc": {}, "Emaxlv": {}}}
        await one.compute_posterior()
        assert slow.free == ("Rmc", "Emaxlv")
        assert one.use()
        key = one.session.loaded[0].posterior
        assert one.bands.members(key).base == {"Rmc": 0.9}

    topics = messages_of(slow, action)
    assert topics[-1][0] == "posterior_ended"
    assert topics[-1][1]["posterior"]["trusted"]


@pytest.mark.parametrize(
    ("aspect", "level", "said"),
    [
        (Aspect.HELD, Level.DOUBTFUL, ["the oxygen consumption is a formula's"]),
        (Aspect.AGREEMENT, Level.POOR, ["POOR FIT, not to be used: nothing was fitted"]),
        (Aspect.AGREEMENT, Level.DOUBTFUL, []),
        (Aspect.HELD, Level.GOOD, []),
    ],
)
def test_draws_that_the_command_line_does_not_trust_are_not_trusted_on_the_page(slow, aspect, level, said):
    """Its weights were good, so the page showed them as trusted beside a fit that said they are not."""
    slow.may_end.set()
    reason = Reason(aspect, level, "", "the oxygen consumption is a formula's")

    async def action(one, messages):
        await one.start(form())
        subject = next(iter(one._fitted))
        fitted = one._fitted[subject]
        one._fitted[subject] = replace(fitted, case=CASE.model_copy(update={"parameters": {"Rmc": 0.9}}))
        verdict = FitVerdict(None, (reason,)).as_object()
        one._fits[subject] = {"parameters": {"Rmc": {}}, "verdict": verdict}
        await one.compute_posterior()

    topic, data = messages_of(slow, action)[-1]
    assert topic == "posterior_ended"
    assert data["posterior"]["doubts"] == said
    assert data["posterior"]["trusted"] == (not said)


def test_a_posterior_can_be_cancelled(slow):
    async def action(one, messages):
        slow.may_end.set()
        await one.start(form())
        slow.may_end.clear()
        search = asyncio.create_task(one.compute_posterior())
        await until(lambda: len(slow.running) == 2)
        one.cancel()
        await asyncio.wait_for(search, PATIENCE_S)
        assert not one.running
        slow.may_end.set()

    assert last_message_of(messages_of(slow, action)) == ("posterior_ended", identify.text("fit_cancelled"))


def test_cancel_frees_the_page_at_once(slow):
    async def action(one, messages):
        fit = asyncio.create_task(one.start(form()))
        await until(lambda: slow.running)
        one.cancel()
        await asyncio.wait_for(fit, PATIENCE_S)  # the computation itself goes on for longer
        assert not one.running
        assert not one.use()
        slow.may_end.set()

    messages = messages_of(slow, action)
    assert last_message_of(messages) == ("fit_ended", identify.text("fit_cancelled"))


def test_a_fit_that_fails_says_why_and_leaves_the_page_usable(slow):
    slow.answer = FitError("no heartbeat")
    slow.may_end.set()

    async def action(one, messages):
        await one.start(form())
        assert not one.running
        assert not one.use()

    assert last_message_of(messages_of(slow, action)) == ("fit_ended", "no heartbeat")


def test_a_form_with_mistakes_is_not_fitted(slow):
    async def action(one, messages):
        await one.start(form(measurements__SP="x"))

    messages_of(slow, action)
    assert slow.running == []


def test_the_reasons_of_a_verdict_name_no_option_that_the_page_has_not():
    goodness = Goodness({"SP": 6.0, "MAP": 0.1}, 36.0, 3.0, 1e-7)
    measured, simulated = {"SP": 120.0, "MAP": 70.0}, {"SP": 80.0, "MAP": 71.0}
    own = {"Rmc": {"value": 1.0, "lower": 0.9, "upper": 1.1, "identifiable": True, "reason": ""}}
    other = {"Rmc": {"lower": 2.0, "upper": 3.0}}
    reasons = [
        *agreement(measured, simulated, goodness, "relative"),
        *interval_agreement(own, other, "posterior"),
        Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "Csart", "Csart at its bound; with wider --bounds it fits"),
        Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "", "something else (--seed 3) may help"),
        Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "", "ask for --another-option now"),
    ]
    assert sum("--" in reason.sentence for reason in reasons) == 5
    message = [in_page_words(reason.sentence) for reason in reasons]
    assert not any("--" in sentence for sentence in message), message
    assert any("this page weighs each difference by the measured value" in sentence for sentence in message)
    result = judged(
        {"parameters": own, "verdict": FitVerdict(goodness, tuple(reasons[:1])).as_object()}, other
    )
    assert "--" not in str(result["verdict"]["reasons"])
    assert "--" not in result["parameters"]["Rmc"]["reason"]


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        (
            "free it (--parameters Rmc,gas.vo2_ml_min) or give it",
            "free it (an option of eclsim identify) or give it",
        ),
        (
            "measure it, free them (--free), or give",
            "measure it, free them (an option of eclsim identify), or give",
        ),
        ("free it (x among --parameters)", "free it (x among an option of eclsim identify)"),
        ("weigh (--weights uncertainty-like)", "weigh (an option of eclsim identify)"),
        ("a posterior (--posterior) covers both", "a posterior (press Uncertainty) covers both"),
        (
            "may fit nothing: see the figure pairs; a",
            "may fit nothing: see the loops once this patient is used; a",
        ),
    ],
)
def test_options_of_the_command_line_are_whole_words_on_the_page(written, shown):
    assert in_page_words(written) == shown


def test_the_blood_volume_is_fitted_where_the_central_venous_pressure_was_measured():
    raw = CASE.as_mapping() | {"measurements": {"MAP": 80.0, "CVP": 12.0}}
    case, settings = prepared_for_fit(raw, "as_published")
    assert case.fluid is not None
    assert settings.parameters[-1] == "fluid.extra_volume_ml"
    without, usual = prepared_for_fit(raw | {"measurements": {"MAP": 80.0}}, "as_published")
    assert without.fluid is None
    assert "fluid.extra_volume_ml" not in usual.parameters


@pytest.mark.slow
def test_measured_gases_are_fitted_by_what_they_tell_of():
    raw = read_case(EXAMPLE).case.as_mapping()
    settings = prepared_for_fit(raw, "as_published")[1]
    assert settings.parameters == (
        "gas.shunt_fraction", "gas.vo2_ml_min", "ecmo.drainage_mixing", "ecmo.oxygenator.clotted_fraction",
        "Rmc",
    )  # fmt: skip
    assert prepared_for_fit(raw, "as_published", ("Rmc", "Csart"))[1].parameters == ("Rmc", "Csart")


def test_a_shunt_that_nobody_has_turned_on_the_page_is_an_assumed_one():
    raw = read_case(EXAMPLE).case.as_mapping()
    for turned, known in ((0.4, False), (LUNGS_WITHOUT_ECMO["shunt_fraction"], False), (0.3, True)):
        case = prepared_for_fit(
            raw | {"gas": {**raw["gas"], "shunt_fraction": turned}}, "as_published", ("Rmc",)
        )[0]
        assert case.gas.shunt_fraction == turned
        assert ("shunt_fraction" in case.gas.model_fields_set) is known
