"""Numbers inside the allowed range that were probably meant in another unit or with another sign."""

import pytest

from eclsim.cases.reading import read_mapping

RAW = {
    "format": 1,
    "patient": {
        "id": "P", "sex": "male", "age_years": 50, "height_cm": 180, "weight_kg": 80, "heart_rate_bpm": 90,
    },
    "gas": {"haemoglobin_g_dl": 10.0},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VV",
        "drainage_fr": 25, "return_fr": 21,
    },
    "crrt": {"flow_ml_min": 150, "access_site": "post_oxy", "return_site": "pre_pump"},
}  # fmt: skip


def said_of(key, value):
    """Warnings about a key of a case in which it has a value."""
    section, name = key.split(".")
    reading = read_mapping(RAW | {section: {**RAW.get(section, {}), name: value}})
    return [str(warning) for warning in reading.warnings if warning.key == key]


@pytest.mark.parametrize(
    ("key", "value", "meant"),
    [
        ("crrt.dialysate_ml_h", 25, "25 mL/kg/h = 2000 mL/h"),
        ("crrt.replacement_pre_ml_h", 35, "35 mL/kg/h = 2800 mL/h"),
        ("crrt.net_ultrafiltration_ml_h", 1.5, "1.5 mL/kg/h = 120 mL/h"),
        ("gas.vo2_ml_min", 120, "120 mL/min/m2 = 240 mL/min"),
        ("gas.base_excess_mmol_l", 24, "a bicarbonate of 24 mmol/L = a base excess of -0.6 mmol/L"),
        ("solutes.urea_mmol_l", 90, "90 mg/dL of urea = 15.0 mmol/L, or of urea nitrogen = 32.1 mmol/L"),
        ("measurements.drainage_pressure", 60, "-60"),
        ("measurements.pump_inlet_pressure", 75, "-75"),
        ("ecmo.speed_rpm", 2.725, "2.725 krpm = 2725 rpm"),
        ("drugs.dobutamine", 0.005, "0.005 mg/kg/min = 5 ug/kg/min"),
        ("drugs.noradrenaline", 0.0002, "0.0002 mg/kg/min = 0.2 ug/kg/min"),
    ],
)
def test_a_number_of_another_unit_is_doubted(key, value, meant):
    (warning,) = said_of(key, value)
    assert warning.endswith(f"; did you mean {meant}?")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("crrt.dialysate_ml_h", 0),
        ("crrt.dialysate_ml_h", 500),
        ("crrt.net_ultrafiltration_ml_h", 20),
        ("gas.vo2_ml_min", 170),
        ("gas.vo2_ml_min", 420),
        ("gas.base_excess_mmol_l", 12),
        ("gas.base_excess_mmol_l", -20),
        ("solutes.urea_mmol_l", 45),
        ("measurements.drainage_pressure", -60),
        ("measurements.drainage_pressure", 12),
        ("drugs.dobutamine", 1),
        ("drugs.noradrenaline", 0.01),
    ],
)
def test_usual_numbers_are_not_doubted(key, value):
    assert said_of(key, value) == []


def test_a_consumption_more_than_twice_the_usual_is_doubted():
    (warning,) = said_of("gas.vo2_ml_min", 900)
    assert "357 % of the 252 mL/min" in warning


def test_cold_patients_may_consume_little():
    gas = {"gas": {"haemoglobin_g_dl": 10.0, "vo2_ml_min": 110, "temperature_c": 30}}
    assert not [w for w in read_mapping(RAW | gas).warnings if w.key == "gas.vo2_ml_min"]


def test_a_circuit_that_drains_an_artery_has_no_suction():
    cannulae = {"drainage_cannula": "venous", "return_cannula": "arterial"}
    ecmo = {**RAW["ecmo"], "drainage_site": "ao", "return_site": "ra", **cannulae}
    del ecmo["mode"]
    case = RAW | {"ecmo": ecmo, "measurements": {"drainage_pressure": 60}}
    assert not [w for w in read_mapping(case).warnings if w.key == "measurements.drainage_pressure"]


SITES = ("drainage_site", "return_site", "second_drainage_site", "second_return_site", "return_cannula")


def doubted_sites(**ecmo):
    """Warnings about sites and cannulae, by key, of a case on ECMO."""
    raw = {k: v for k, v in RAW["ecmo"].items() if k != "mode"}
    cannulae = {"drainage_cannula": "venous", "return_cannula": "arterial"}
    case = RAW | {"ecmo": raw | cannulae | ecmo}
    warnings = read_mapping(case).warnings
    return {w.key.partition(".")[2]: str(w) for w in warnings if w.key in {f"ecmo.{s}" for s in SITES}}


@pytest.mark.parametrize(
    ("key", "ecmo", "words"),
    [
        ("drainage_site", {"drainage_site": "sart", "return_site": "ao"}, "drains systemic artery: "),
        ("return_site", {"drainage_site": "svn", "return_site": "pvn"}, "returns to pulmonary vein: "),
        ("return_site", {"drainage_site": "ra", "return_site": "rv"}, "returns to right ventricle: "),
        ("return_site", {"drainage_site": "la", "return_site": "ra"}, "a shunt from the left to"),
        ("return_site", {"drainage_site": "ao", "return_site": "pas"}, "an arterio-venous shunt"),
        ("return_site", {"drainage_site": "pas", "return_site": "ra"}, "against the heart's own flow"),
        (
            "second_drainage_site",
            {
                "drainage_site": "ra", "return_site": "ao", "second_drainage_site": "sart",
                "second_drainage_fr": 19,
            },
            "drains systemic artery",
        ),
        (
            "second_return_site",
            {"drainage_site": "ra", "return_site": "ao", "second_return_site": "lv", "second_return_fr": 15},
            "returns to left ventricle",
        ),
        (
            "return_cannula", {"drainage_site": "ra", "return_site": "ao", "return_cannula": "venous"},
            "a Getinge HLS venous cannula in aorta: arterial ones return to arteries; did you mean",
        ),
    ],
)  # fmt: skip
def test_a_cannula_in_a_vessel_where_none_is_put_is_doubted(key, ecmo, words):
    """A venous cannula in an artery, and a return to the pulmonary veins, were taken without a word."""
    doubted = doubted_sites(**ecmo)
    assert set(doubted) == {key}
    assert words in doubted[key]


@pytest.mark.parametrize(
    "ecmo",
    [
        {"drainage_site": "ra", "return_site": "ao"},
        {"drainage_site": "svn", "return_site": "ra"},
        {"drainage_site": "ra", "return_site": "svn"},
        {"drainage_site": "svn", "return_site": "ra", "return_cannula": "venous"},
        {"drainage_site": "ra", "return_site": "pas"},
        {"drainage_site": "la", "return_site": "ao"},
        {
            "drainage_site": "ra",
            "return_site": "sart",
            "second_drainage_site": "la",
            "second_drainage_fr": 15,
        },
        {"drainage_site": "ra", "return_site": "ao", "second_return_site": "svn", "second_return_fr": 17},
        {"drainage_site": "svn", "return_site": "ra", "second_return_site": "ao", "second_return_fr": 17},
    ],
)
def test_usual_modes_are_not_doubted(ecmo):
    assert doubted_sites(**ecmo) == {}


def test_a_course_may_slow_a_pump_down_and_start_it_slowly():
    """Only a fit and a table of measurements refuse a speed that no pump has while a patient is measured."""
    slow = {"at_min": 1, "ramp_min": 2, "set": {"ecmo.speed_rpm": 2.5}}
    started = {**RAW["ecmo"], "speed_rpm": 50}
    assert read_mapping(RAW | {"ecmo": started, "measurements": {"MAP": 70}, "events": [slow]}).case.events
