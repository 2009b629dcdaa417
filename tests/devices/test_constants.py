"""Device laws against published points."""

import math

import numpy as np
import pytest

from eclsim.devices import ecmo, lvad
from eclsim.devices.ecmo import CANNULAE, OXYGENATORS
from eclsim.devices.lvad import Lvad

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
