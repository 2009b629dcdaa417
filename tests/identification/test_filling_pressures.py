"""Central venous pressure and the pressures of the ECMO and CRRT circuits as measurements."""

import numpy as np
import pytest

from eclsim.cases.case import Measurements
from eclsim.cases.quantities import with_values
from eclsim.cases.reading import read_mapping
from eclsim.identification.fit import fit
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.quantities import relative_scale
from eclsim.identification.settings import (
    FitSettings,
    avoidable_assumptions,
    check_fit,
    checked_fit,
    parameters_informed_by_pressures,
    remarks_on_assumptions,
)
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.thiel2025 import BOUNDS, PARAMETERS
from eclsim.sensitivity.identifiability import identifiability

RAW = {
    "format": 1,
    "patient": {
        "id": "P", "sex": "male", "age_years": 50, "height_cm": 178, "weight_kg": 80, "heart_rate_bpm": 95,
    },
    "fluid": {},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VA",
        "drainage_fr": 23, "return_fr": 17,
    },
}  # fmt: skip
CASE = read_mapping(RAW).case
CIRCUIT = (
    "drainage_pressure", "pump_inlet_pressure", "pre_oxygenator_pressure", "post_oxygenator_pressure"
)  # fmt: skip


def measured(names, **values):
    model = model_of(CASE).with_values(values)
    outputs = steady_beat(Batch.of(model), names).outputs()
    return CASE.model_copy(update={"measurements": Measurements(**{n: float(outputs[n]) for n in names})})


def test_relative_differences_of_what_may_be_negative_are_of_at_least_its_usual_size():
    assert relative_scale("CVP", 0.0) == relative_scale("CVP", -4.0) == 10.0
    assert relative_scale("CVP", 15.0) == 15.0
    assert relative_scale("drainage_pressure", -20.0) == 60.0
    assert relative_scale("MAP", 50.0) == 50.0
    assert relative_scale("CO", 0.0) == 0.0


def test_pressures_of_a_circuit_that_is_not_there_are_named():
    single = read_mapping({k: v for k, v in RAW.items() if k != "ecmo"}).case
    case = single.model_copy(
        update={
            "measurements": Measurements(
                MAP=70.0, CVP=9.0, drainage_pressure=-40.0, crrt_access_pressure=-60.0
            )
        }
    )
    checked = check_fit(case, {"Rmc": (0.5, 0.05, 5.0)})
    assert set(checked.targets) == {"MAP", "CVP"}
    assert any(w.key == "measurements.crrt_access_pressure" and "[crrt]" in str(w) for w in checked.warnings)
    assert any(w.key == "measurements.drainage_pressure" and "[ecmo]" in str(w) for w in checked.warnings)
    assert not any("oxygenator" in note.key or "CVP" in note.key for note in checked.notes)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("CVP", 1300.0, "1300 Pa = 9.751 mmHg"),
        ("drainage_pressure", -9000.0, "-9000 Pa = -67.51 mmHg"),
        ("post_oxygenator_pressure", "25 kPa", "187.5"),
    ],
)
def test_other_units_are_named(key, value, message):
    with pytest.raises(CaseError, match=f"measurements.{key}") as error:
        read_mapping(RAW | {"measurements": {key: value}})
    assert message in str(error.value)


@pytest.mark.slow
def test_central_venous_pressure_tells_the_blood_volume():
    truth = {"Rmc": 0.4, "Emaxlv": 1.1, "fluid.extra_volume_ml": 450.0}
    names = ("SP", "DP", "MAP", "CO", "PF", "CVP", *CIRCUIT)
    case = measured(names, **truth)
    assert case.measurements.CVP > 5.0 > case.measurements.drainage_pressure
    settings = FitSettings(tuple(truth), weights="uncertainty", multi_start=MultiStart.quick(300))
    result = fit(case, settings=settings)
    fitted = [result.parameters[name].value for name in truth]
    np.testing.assert_allclose(fitted, list(truth.values()), rtol=2e-3)
    assert not result.parameters["fluid.extra_volume_ml"].identifiable
    assert "compensates for errors in Csart" in result.parameters["fluid.extra_volume_ml"].reason
    known = with_values(case, {n: PARAMETERS[n].value for n in BOUNDS if n not in truth})
    assert fit(known, settings=settings).parameters["fluid.extra_volume_ml"].identifiable


@pytest.mark.slow
def test_pressures_of_the_crrt_tell_the_bore_of_its_lines_and_how_clotted_the_filter_is():
    raw = RAW | {"crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"}}
    crrt = read_mapping(raw).case
    lines = ("crrt_access_pressure", "crrt_return_pressure", "crrt_filter_pressure_drop")
    truth = {"Dcrrttuin": 0.35, "Dcrrttuout": 0.29, "Rcrrtfil": 30.0, "Rmc": 0.7}
    model = model_of(crrt).with_values(truth)
    outputs = steady_beat(Batch.of(model), ("MAP", *lines)).outputs()
    values = {name: float(outputs[name]) for name in ("MAP", *lines)}
    case = crrt.model_copy(update={"measurements": Measurements(**values)})
    settings = FitSettings(tuple(truth), weights="uncertainty", multi_start=MultiStart.quick(30))
    result = fit(case, settings=settings)
    fitted = [result.parameters[name].value for name in truth]
    np.testing.assert_allclose(fitted, list(truth.values()), rtol=2e-3)
    assert all(result.parameters[name].identifiable for name in ("Dcrrttuin", "Dcrrttuout", "Rcrrtfil"))
    assert parameters_informed_by_pressures(case) == ("Dcrrttuin", "Dcrrttuout", "Rcrrtfil")
    assert parameters_informed_by_pressures(result.case) == ()


@pytest.mark.slow
def test_it_is_among_what_is_asked_for_identifiability():
    free, names = ("Rmc", "fluid.extra_volume_ml"), ("MAP", "CO")
    few = identifiability(measured(names), parameters=free)
    more = identifiability(measured((*names, "CVP")), parameters=free)
    assert tuple(few.measured) == names
    assert tuple(more.measured) == (*names, "CVP")
    assert few.proposal.relative_errors["Rmc"] > more.proposal.relative_errors["Rmc"]


@pytest.mark.slow
def test_what_is_zero_has_an_effect_too():
    """A share of a volume of 0 mL is none: the change is a fixed one."""
    result = identifiability(measured(("MAP", "CVP")), parameters=("Rmc", "fluid.extra_volume_ml"))
    assert CASE.fluid.extra_volume_ml == 0.0
    low, high = (measured(("MAP", "CVP"), **{"fluid.extra_volume_ml": v}).measurements for v in (-1.0, 1.0))
    slope = np.array([high.MAP - low.MAP, high.CVP - low.CVP]) / 2.0
    expected = slope * (5000.0 + 3000.0) / np.log(100.0) / [3.0, 2.0]
    np.testing.assert_allclose(result.scaled.matrix[:, 1], expected, rtol=1e-4)
    assert "no effect" not in " ".join(result.proposal.excluded.values())


@pytest.mark.slow
def test_a_fit_that_holds_the_volume_says_so_where_it_misses_the_central_venous_pressure():
    case = measured(("MAP", "CO", "CVP"), **{"fluid.extra_volume_ml": 1500.0})
    settings = FitSettings(("Rmc", "Emaxlv"), weights="uncertainty", multi_start=MultiStart.quick(100))
    held = fit(case, settings=settings)
    assert held.verdict.level != "good"
    assert any("free fluid.extra_volume_ml" in reason.sentence for reason in held.verdict.reasons)


VOLUME = "fluid.extra_volume_ml"


def without_fluid(**values):
    return read_mapping({k: v for k, v in RAW.items() if k != "fluid"} | {"measurements": values}).case


@pytest.mark.slow
def test_the_blood_volume_can_be_free_without_its_section():
    """The advice of a fit that misses CVP is followed as it stands."""
    twin = measured(("MAP", "CO", "CVP"), **{"Rmc": 0.6, VOLUME: 450.0})
    case = twin.model_copy(update={"fluid": None})
    checked = checked_fit(case, FitSettings(("Rmc", VOLUME)))
    assert not checked.mistakes
    assert VOLUME in checked.free
    assert any(note.key == VOLUME and "[fluid]" in str(note) for note in checked.notes)
    settings = FitSettings(("Rmc", VOLUME), weights="uncertainty", multi_start=MultiStart.quick(20))
    result = fit(case, settings=settings)
    assert result.case.fluid.extra_volume_ml == result.parameters[VOLUME].value
    assert result.parameters[VOLUME].value == pytest.approx(450.0, rel=0.01)


def test_a_held_blood_volume_is_said_with_what_follows_from_it():
    """An overloaded heart is fitted away by the others, to the last digit of the CVP (PCWP 4 for 29 mmHg)."""
    told, untold = without_fluid(MAP=70.0, CVP=3.1), without_fluid(MAP=70.0, MPAP=20.0)
    (doubt,) = avoidable_assumptions(told, ("MAP", "CVP"), ("Rmc",))
    assert "PCWP, MPAP and the volumes of the heart depend on it" in doubt
    assert VOLUME in doubt
    assert remarks_on_assumptions(told, ("MAP", "CVP"), ("Rmc",)) == {}
    remark = remarks_on_assumptions(untold, ("MAP", "MPAP"), ("Rmc",))[VOLUME]
    assert "PCWP, CVP and the volumes of the heart depend on it" in remark
    assert avoidable_assumptions(untold, ("MAP", "MPAP"), ("Rmc",)) == []
    given = read_mapping(RAW | {"fluid": {"extra_volume_ml": 300}}).case
    for case, free in ((told, (VOLUME,)), (given, ("Rmc",))):
        assert remarks_on_assumptions(case, ("MAP",), free) == {}
        assert avoidable_assumptions(case, ("CVP",), free) == []


@pytest.mark.slow
def test_a_fit_that_holds_the_volume_says_so():
    settings = FitSettings(("Rmc",), multi_start=MultiStart.quick(20))
    given = {name: bounds.start for name, bounds in BOUNDS.items()}  # so that the volume alone is held
    for values, level in (({"MAP": 70.0}, "good"), ({"MAP": 70.0, "CVP": 3.2}, "doubtful")):
        case = without_fluid(**values).model_copy(update={"parameters": given})
        reasons = fit(case, settings=settings).verdict.reasons
        (said,) = [r for r in reasons if "the blood volume is held" in r.sentence]
        assert said.level == level
