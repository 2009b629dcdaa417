"""What the ECMO circuit says of a beat besides limits."""

from pathlib import Path

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.components.exchangers import FLOWMETER_TO_STPD

LOW_SWEEP = Path(__file__).parents[2] / "examples/veno_venous_low_sweep.toml"


def used_up(sweep: float, fdo2: float = 1.0):
    """The beat at a sweep, and the warnings that say its gas is used up."""
    case = eclsim.read_case(LOW_SWEEP).case.with_section("ecmo", sweep_l_min=sweep, fdo2=fdo2)
    beat = eclsim.simulate(case)
    return beat, [text for text in beat.attrs["warnings"] if "sweep gas" in text]


@pytest.mark.parametrize("sweep", [0.05, 0.17, 0.2])
def test_a_sweep_that_the_blood_takes_up_is_said_where_no_carbon_dioxide_leaves(sweep):
    beat, (said,) = used_up(sweep)
    brought = 1000.0 * FLOWMETER_TO_STPD * sweep
    assert float(beat["VO2_oxygenator"]) == pytest.approx(brought, rel=0.01)
    assert float(beat["VCO2_oxygenator"]) < 0.1
    assert np.isnan(float(beat["PexhaustCO2"]))
    assert f"of {brought:.0f} mL/min STPD" in said
    assert "removes 0 mL/min of carbon dioxide; raise the sweep" in said


@pytest.mark.parametrize(("sweep", "fdo2"), [(0.0, 1.0), (0.3, 1.0), (0.17, 0.21)])
def test_nothing_is_said_of_a_sweep_that_is_off_or_leaves_the_oxygenator(sweep, fdo2):
    beat, said = used_up(sweep, fdo2)
    assert beat.attrs["converged"]
    assert said == []


def veno_venous(**ecmo):
    """What is said about a case on V-V ECMO with gas exchange and the given keys of its circuit."""
    raw = {
        "format": 1,
        "patient": {"id": "v", "sex": "male", "age_years": 45, "heart_rate_bpm": 95},
        "gas": {},
        "ecmo": {
            "mode": "VV", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult",
            "drainage_fr": 25, "return_fr": 19, **ecmo,
        },
    }  # fmt: skip
    reading = read_mapping(raw)
    return [
        [(one.key, one.message) for one in remarks if "share no compartment" in one.message]
        for remarks in (reading.warnings, reading.notes)
    ]


def test_mixing_where_drainage_and_return_are_apart_is_said_to_have_no_effect():
    """`mode = "VV"` drains svn and returns to ra: a mixing of 0.33 gave 3 % of recirculation, silently."""
    (warning,), notes = veno_venous(drainage_mixing=0.33)
    assert warning[0] == "ecmo.drainage_mixing"
    assert 'without effect: drainage ("svn") and return ("ra")' in warning[1]
    assert 'write drainage_site and return_site = "ra"' in warning[1]
    assert not notes
    warnings, ((key, message),) = veno_venous()
    assert not warnings
    assert key == "ecmo.drainage_site"
    assert "the more the higher the flow" in message
    assert "9 to 28 % at 4 L/min" in message
    assert veno_venous(drainage_site="ra", return_site="ra", drainage_mixing=0.33) == [[], []]


@pytest.mark.parametrize(("site", "opposed"), [("ra", False), ("pas", False), ("ao", True)])
def test_only_an_ecmo_that_returns_to_arteries_opposes_an_lvad(site, opposed):
    """A right-sided ECMO fills the LVAD; it was said that the two may oppose each other."""
    raw = {
        "format": 1,
        "patient": {"id": "l", "sex": "male", "age_years": 57, "heart_rate_bpm": 95},
        "lvad": {"pump": "HM3", "speed_rpm": 5400, "inlet_site": "lv", "outlet_site": "ao"},
        "gas": {},
        "ecmo": {
            "pump": "Rotaflow", "speed_rpm": 2800, "oxygenator": "Quadrox-i Adult", "drainage_fr": 25,
            "return_fr": 19, "drainage_site": "ra", "drainage_cannula": "venous", "return_site": site,
            "return_cannula": "arterial",
        },
    }  # fmt: skip
    notes = [note.message for note in read_mapping(raw).notes]
    assert any("oppose each other" in note for note in notes) is opposed


@pytest.mark.parametrize(("clamp", "said"), [(0.0, False), (0.97, True), (1.0, False)])
def test_a_flow_below_the_label_is_said_of_a_kinked_return_line(clamp, said):
    """At a clamp of 0.97 the flow of 0.2 L/min broke no limit; blood clots in it as without a clamp."""
    case = eclsim.read_case(LOW_SWEEP).case.with_section("ecmo", return_clamp=clamp)
    warnings = eclsim.simulate(case).attrs["warnings"]
    assert any("below 0.5 L/min: outside the label" in one for one in warnings) == said


@pytest.mark.parametrize(("speed", "clamp"), [(0.0, 0.0), (0.0, 1.0), (1500.0, 0.0)])
def test_a_veno_venous_pump_that_stands_still_is_said_to_supply_nobody(speed, clamp):
    """A flow of -0.0005 L/min was "outside the label", and nothing was said of the 706 mmHg behind it."""
    raw = eclsim.read_case(LOW_SWEEP).case.as_mapping()
    reading = read_mapping(raw | {"ecmo": raw["ecmo"] | {"speed_rpm": speed, "return_clamp": clamp}})
    beat = eclsim.simulate(reading.case)
    read = [one.message for one in reading.warnings if "stands still" in one.message]
    assert any("hardly any blood flows through it" in one for one in read) == (not speed and not clamp)
    assert len(read) <= 1
    warnings = beat.attrs["warnings"]
    assert any("stands still, and 0.00 L/min pass its oxygenator" in one for one in warnings) == bool(read)
    assert any("blood stands in the ECMO circuit" in one for one in warnings) == (speed == 0.0)
    assert not any("outside the label" in one for one in warnings)
    assert bool(float(beat["VO2_oxygenator"]) < 1.0) == (speed == 0.0)


def test_a_kinked_drainage_line_has_the_resistance_of_its_open_area():
    """Half of the area has four times the resistance; a kink could only be stated as a smaller cannula."""
    whole = eclsim.read_case(LOW_SWEEP).case
    results = [eclsim.simulate(whole.with_section("ecmo", drainage_clamp=c)) for c in (0.0, 0.5, 0.9)]
    flows, inlets = ([float(r[name]) for r in results] for name in ("PF", "drainage_pressure"))
    assert flows[0] == pytest.approx(float(eclsim.simulate(whole)["PF"]), rel=1e-7)
    assert flows == sorted(flows, reverse=True)
    assert inlets == sorted(inlets, reverse=True)
    dropped = [float(r["right_atrial_pressure"] - r["drainage_pressure"]) for r in results]
    resistances = np.array(dropped) / np.array(flows) ** 2  # flows hardly pulsate
    assert resistances[1:] / resistances[0] == pytest.approx([4.0, 100.0], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("circuit", "device"),
    [
        ({"second_drainage_site": "la", "second_drainage_fr": 19}, {}),
        ({}, {"vent": {"site": "la", "fr": 14}}),
    ],
)
def test_the_drained_blood_is_all_that_the_oxygenator_gets(circuit, device):
    """It was that of the first cannula: 60 % where 72 % entered the oxygenator, as its uptake showed."""
    raw = {
        "format": 1,
        "patient": {"id": "v", "sex": "male", "age_years": 58, "heart_rate_bpm": 95},
        "gas": {"haemoglobin_g_dl": 10.0},
        "parameters": {"Emaxlv": 0.6, "Emaxrv": 0.4, "Rmc": 0.9},
        "ecmo": {
            "mode": "VA", "pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult",
            "drainage_fr": 25, "return_fr": 17, "fdo2": 0.7, **circuit,
        },
        **device,
    }  # fmt: skip
    beat = eclsim.simulate(read_mapping(raw).case)
    of = {name: float(beat[name]) for name in ("SpreO2", "PpreO2", "SpostO2", "PpostO2", "PF", "SvO2")}
    before, behind = (0.0134 * 10.0 * of[f"S{at}O2"] + 0.0031 * of[f"P{at}O2"] for at in ("pre", "post"))
    assert float(beat["VO2_oxygenator"]) == pytest.approx(10.0 * of["PF"] * (behind - before), rel=1e-3)
    assert of["SpreO2"] > of["SvO2"] + 5.0


@pytest.mark.slow
def test_recirculation_is_that_of_the_blood_of_both_drainage_cannulae():
    """It was that of the first: a second in the veins raised it from 0.20 to 0.23, where it falls to 0.13."""
    two = {"second_drainage_site": "svn", "second_drainage_fr": 21}
    shares = []
    for second in ({}, two):
        raw = {
            "format": 1,
            "patient": {"id": "v", "sex": "male", "age_years": 58, "heart_rate_bpm": 95},
            "gas": {"haemoglobin_g_dl": 9.5, "shunt_fraction": 0.8, "vo2_ml_min": 240},
            "ecmo": {
                "pump": "Rotaflow", "speed_rpm": 3400, "oxygenator": "Quadrox-i Adult",
                "drainage_site": "ra", "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "ra",
                "return_cannula": "arterial", "return_fr": 19, "drainage_mixing": 0.33, **second,
            },
        }  # fmt: skip
        beat = eclsim.simulate(read_mapping(raw).case)
        of = {
            place: 0.0134 * 9.5 * float(beat[f"S{place}O2"]) + 0.0031 * float(beat[f"P{place}O2"])
            for place in ("a", "pre", "post")
        }
        venous = of["a"] - float(beat["VO2"]) / (10.0 * float(beat["CO"]))
        shares.append(float(beat["recirculation_fraction"]))
        assert shares[-1] == pytest.approx((of["pre"] - venous) / (of["post"] - venous), rel=0.08)
    assert shares[1] < 0.75 * shares[0]


BAD_LUNGS = {
    "format": 1,
    "patient": {"id": "h", "sex": "male", "age_years": 60, "heart_rate_bpm": 90},
    "gas": {"haemoglobin_g_dl": 10, "shunt_fraction": 0.6, "fio2": 0.6},
    "ecmo": {"mode": "VA", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult",
             "drainage_fr": 23, "return_fr": 17},
}  # fmt: skip


def harlequin(gas=None, ecmo=None, **sections):
    """The cautions on differential hypoxaemia, and the beat."""
    changed = {"gas": {**BAD_LUNGS["gas"], **(gas or {})}, "ecmo": {**BAD_LUNGS["ecmo"], **(ecmo or {})}}
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, **changed, **sections}).case)
    return [text for text in beat.attrs["warnings"] if "differential hypoxaemia" in text], beat


def test_one_artery_hides_desaturated_blood_of_the_heart_and_that_is_said():
    """A radial saturation of 93 % stood over a heart that ejected 6 L/min of 86 %."""
    (said,), beat = harlequin()
    assert float(beat["SaO2"]) > 92.0
    named = float(said.split("of about ")[1].split(" %")[0])
    assert named == pytest.approx(beat["Ppvn"].attrs["SO2"], abs=1.5)
    assert '[physiology] regional = true and ecmo.return_site = "lower"' in said
    assert beat["SaO2"].attrs["read_with_care"] == 1
    assert harlequin(gas={"shunt_fraction": 0.1})[0] == []


@pytest.mark.slow
def test_central_return_in_regions_is_named_and_femoral_return_needs_no_caution():
    regions = {"physiology": {"regional": True}}
    (said,), beat = harlequin(**regions)
    assert "returns to the ascending aorta (central cannulation)" in said
    assert "regional = true" not in said
    none, femoral = harlequin(ecmo={"return_site": "lower"}, **regions)
    assert none == []
    assert float(femoral["SaO2"]) < float(beat["SaO2"]) - 4.0


def test_suction_is_said_where_the_pump_draws():
    """The venous pressure of the console is measured before the pump; -115 mmHg there was no warning."""
    beat = eclsim.simulate(read_mapping({**BAD_LUNGS, "ecmo": {**BAD_LUNGS["ecmo"], "speed_rpm": 5000}}).case)
    assert float(beat["pump_inlet_pressure"]) < -100.0 < float(beat["lowest_drainage_pressure"])
    assert beat["pump_inlet_pressure"].attrs["finding"] == "warning"


def test_veno_venous_beside_veno_arterial_ecmo_recirculates_only_what_it_drains_beyond_the_organs_flow():
    """CO was taken for the venous return, which the other circuit raises: 0.30 L/min "flowed back"."""
    pump = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult"}
    raw = {
        "format": 1, "parameters": {"Emaxlv": 0.6},
        "patient": {"id": "two", "sex": "male", "age_years": 60, "heart_rate_bpm": 90},
        "ecmo": {
            "a": pump | {"mode": "VA", "speed_rpm": 3000}, "b": pump | {"mode": "VV", "speed_rpm": 2500},
        },
    }  # fmt: skip
    both = eclsim.simulate(read_mapping(raw).case)
    assert float(both["ecmo.b.PF"]) > float(both["CO"]) + 0.1
    assert not any("back to the drainage cannula" in sentence for sentence in both.attrs["warnings"])
    alone = read_mapping(raw | {"ecmo": {"b": raw["ecmo"]["b"] | {"speed_rpm": 4500}}}).case
    assert any(
        "back to the drainage cannula" in sentence for sentence in eclsim.simulate(alone).attrs["warnings"]
    )
