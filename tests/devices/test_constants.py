"""Device laws against published points."""

import math

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.devices import ecmo, lvad
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.ecmo_parts import OXYGENATORS
from eclsim.devices.lvad import Lvad
from eclsim.inputs.mistakes import CaseError
from eclsim.simulation.single import simulate

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}

# Maker's H-Q chart of the HeartMate 3, read by a third party: speed [rpm], flow [L/min], head [mmHg].
HM3_CHART = [
    (3000, 0, 32), (3000, 2, 23), (4000, 0, 58), (4000, 3, 41), (5000, 0, 90), (5000, 4, 63),
    (6000, 2, 120), (6000, 6, 70), (7000, 0, 177), (7000, 5, 140), (8000, 3, 211), (8000, 8, 126),
    (9000, 2, 278), (9000, 9, 164),
]  # fmt: skip


def test_shut_off_heads_follow_the_constants():
    heads = {("Rotaflow", 1000): 30, ("Rotaflow", 3000): 269, ("Rotaflow", 5000): 747, ("DP3", 5000): 183,
             ("DP3", 10000): 734, ("HVAD", 2600): 91, ("Incor", 7400): 152}  # fmt: skip
    for (name, speed), head in heads.items():
        assert PUMPS[name].head_mmhg(speed, 0) == pytest.approx(head, abs=0.6)


def test_rotaflow_against_a_bench_point_in_bovine_blood():
    assert PUMPS["Rotaflow"].head_mmhg(3000, 4.2) == pytest.approx(250, rel=0.12)


def test_heartmate_3_against_the_chart():
    errors = [PUMPS["HM3"].head_mmhg(speed, flow) - head for speed, flow, head in HM3_CHART]
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) < 6.0


@pytest.mark.parametrize("pump", PUMPS.values(), ids=lambda pump: pump.key)
def test_more_flow_means_less_head_from_the_peak_on(pump):
    for speed in pump.speed_range_rpm:
        heads = np.array([pump.head_mmhg(speed, flow) for flow in np.linspace(0, 12, 200)])
        peak = int(heads.argmax())
        assert np.all(np.diff(heads[peak:]) < 0)


@pytest.mark.parametrize(
    ("kind", "drops"), [("arterial", (240, 130, 74, 49, 32)), ("venous", (81, 57, 40, 27, 16))]
)
def test_cannulae_at_4_l_min(kind, drops):
    cannula = CANNULAE[kind]
    assert [round(cannula.pressure_drop_mmhg(size, 4)) for size in cannula.sizes_fr] == list(drops)


CHARTS = {  # dP = a Q^2 + b Q of each size, with Q in L/min, and the largest pressure of the chart in use
    "avalon_drainage": (90, (17.187, 11.117), (7.7468, 8.4351), (3.4861, 2.3871), (2.0684, -0.6194)),
    "avalon_return": (250, (68.756, 2.2718), (27.066, 1.7003), (10.984, 5.3044), (6.3107, 0.8747)),
    "crescent_drainage": (
        50, (4.0878, 4.4519), (2.6488, 3.7688), (1.9888, 2.4497), (1.058, 4.1433), (1.4009, 0.4532),
    ),
    "crescent_return": (
        150, (18.65, 6.7335), (11.215, 6.0422), (7.9396, 5.5664), (5.6205, 3.5476), (4.3856, 1.5097),
    ),
    "protek_drainage": (60, (2.4682, 2.1438), (1.8139, 4.5159)),
    "protek_return": (200, (14.909, 1.7309), (6.9807, 1.9931)),
}  # fmt: skip


@pytest.mark.parametrize("kind", CHARTS)
def test_both_lumens_follow_the_polynomials_of_their_chart(kind):
    highest, *curves = CHARTS[kind]
    for size, (a, b) in zip(CANNULAE[kind].sizes_fr, curves, strict=True):
        flows = np.linspace(0.0, 7.0, 141)
        chart = a * flows**2 + b * flows
        shown = chart <= highest
        drops = np.array([CANNULAE[kind].pressure_drop_mmhg(size, flow) for flow in flows[shown]])
        assert np.abs(drops - chart[shown]).max() < 9.0, size


@pytest.mark.parametrize("kind", CANNULAE)
def test_a_wider_cannula_resists_less_and_none_is_negative(kind):
    cannula = CANNULAE[kind]
    sizes = np.linspace(cannula.sizes_fr[0], cannula.sizes_fr[-1], 100)
    resistances = [cannula.resistance(size) for size in sizes]
    assert min(resistances) > 0
    assert all(np.diff(resistances) < 0)


def test_labels_of_oxygenators():
    small = OXYGENATORS["Quadrox-i Small Adult"]
    assert small.label_warning(5.0) is None
    assert small.label_warning(5.0 + 1e-9) is None
    assert small.label_warning(5.01) is not None
    assert "0.5 to 5 L/min" in str(small.label_warning(6.5))
    assert "outside" in str(small.label_warning(0.2))
    assert OXYGENATORS["Nautilus MC3"].label_warning(9.0) is None


def test_names():
    assert tuple(ecmo.PUMPS) == ("Rotaflow", "DP3")
    assert tuple(lvad.PUMPS) == ("HMII", "HM3", "HVAD", "Incor")
    section = {"inlet_site": "lv", "outlet_site": "ao", "speed_rpm": 5000}
    assert Lvad(pump="HeartMate II", **section).pump == "HMII"
    assert Lvad(pump="HeartMate III", **section).pump == "HM3"
    assert all(pump.evidence for pump in PUMPS.values())
    assert PUMPS["Incor"].evidence.startswith("unvalidated")


def ecmo_case(**lines):
    patient = {"id": "V-V", "sex": "male", "age_years": 50, "heart_rate_bpm": 90}
    pump = {
        "pump": {"roller_l_min": 4.0},
        "oxygenator": "Quadrox-i Adult",
        "drainage_site": "ra",
        "return_site": "ra",
    }
    return read_mapping({"format": 1, "patient": patient, "gas": {}, "ecmo": pump | lines})


@pytest.mark.parametrize(
    ("drainage", "back", "words"),
    [
        (("crescent_drainage", 28), ("crescent_return", 28), ""),
        (
            ("crescent_drainage", 28),
            ("crescent_return", 30),
            "both lumens of a Medtronic Crescent have one size",
        ),
        (("crescent_drainage", 28), ("venous", 21), "not lumens of one cannula"),
    ],
)
def test_both_lumens_of_a_dual_lumen_cannula_belong_together(drainage, back, words):
    lines = {"drainage": drainage, "return": back}
    read = ecmo_case(
        **{
            f"{line}_{what}": value
            for line, own in lines.items()
            for what, value in zip(("cannula", "fr"), own, strict=True)
        }
    )
    said = [str(mistake) for mistake in read.warnings if "cannula" in mistake.key or "_fr" in mistake.key]
    assert words in " ".join(said)
    assert bool(said) == bool(words)


def test_a_return_lumen_does_not_drain():
    with pytest.raises(CaseError, match="avalon_drainage"):
        ecmo_case(
            drainage_cannula="avalon_return", drainage_fr=27, return_cannula="avalon_return", return_fr=27
        )


@pytest.mark.parametrize("product", ["avalon", "crescent"])
def test_a_chart_in_water_is_said_where_suction_is_shown(product):
    lines = {f"{line}_cannula": f"{product}_{line}" for line in ("drainage", "return")}
    case = ecmo_case(**lines, drainage_fr=28 if product == "crescent" else 27, return_fr=27).case
    said = [line for line in simulate(case).attrs["warnings"] if "before its pump are too mild" in line]
    assert len(said) == (product == "avalon")
