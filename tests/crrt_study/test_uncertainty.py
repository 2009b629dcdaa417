import numpy as np
import pytest

from eclsim.crrt_study.schemes import SpeedError
from eclsim.crrt_study.study import crrt_study
from eclsim.inputs.mistakes import CaseError
from eclsim.paper.crrt import paper_case


def test_samples_at_the_patient_give_certainty_and_wide_ones_do_not():
    samples = {"Dcrrttuout": [0.3175, 0.3175, 0.3175, 0.22, 0.2]}
    result = crrt_study(
        paper_case(), schemes="d,g", speeds="3425", volume_policy="as_published", samples=samples
    )
    doubt = result.uncertainty
    assert doubt.attrs["samples"] == 5
    median = doubt["Pcrrttuout_quantiles"].sel(quantile=0.5)
    np.testing.assert_allclose(median, result.means["Pcrrttuout"].sel(speed=3425.0).squeeze(), rtol=1e-6)
    kept = doubt["probability_kept"].sel(scheme="g")
    assert float(kept.sel(limit="access_alarm")) == 1.0
    assert float(kept.sel(limit="crrt")) == pytest.approx(float(kept.min()))
    assert float(kept.sel(limit="return_alarm")) == 0.6
    units = {n: doubt[f"{n}_quantiles"].attrs["units"] for n in ("Psart", "Pcrrttuin", "Pcrrttuout", "PF")}
    assert units == {"Psart": "mmHg", "Pcrrttuin": "mmHg", "Pcrrttuout": "mmHg", "PF": "L/min"}
    assert result.ranking["as_published"][0].letter == "d"


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        ({"Rmcc": [0.4, 0.5]}, "Rmcc: not a parameter that this study uses; did you mean Rmc"),
        ({"Rmc": [0.4, 0.5], "Emaxlv": [1.0]}, "numbers of samples; allowed"),
        ({"Rmc": [0.4, float("nan")]}, "Rmc = nan: sample 2 is out of range; allowed"),
        ({"Rmc": [0.4, 800.0]}, "Rmc = 800: sample 2 is out of range; allowed"),
        ({}, "numbers of samples"),
    ],
)
def test_samples_that_nothing_reads_or_that_cannot_be_are_refused(samples, said):
    """A misspelt name gave certainty: nothing that was varied was read."""
    with pytest.raises(CaseError) as refused:
        crrt_study(paper_case(), schemes="d", speeds="3425", volume_policy="as_published", samples=samples)
    assert said.partition(";")[0] in str(refused.value)


@pytest.mark.parametrize("speeds", [[-100.0, 3000.0], [0.0], [float("nan")]])
def test_speeds_from_python_are_checked_as_those_of_the_command_line(speeds):
    with pytest.raises(SpeedError, match="are not speeds; allowed"):
        crrt_study(paper_case(), schemes="d", speeds=speeds)


def test_samples_that_no_patient_can_have_say_nothing_of_limits():
    """At 5500 rpm a chamber is without blood where Rmc = 0.9: that beat converged, and counted."""
    case = paper_case().with_section("ecmo", speed_rpm=5500.0)
    chosen = {"schemes": "d", "speeds": [5500.0], "volume_policy": "as_published"}
    both = crrt_study(case, **chosen, samples={"Rmc": [0.4, 0.9]})
    alone = crrt_study(case, **chosen, samples={"Rmc": [0.4]}).uncertainty
    assert both.samples_without_a_beat == {"d": 1}
    assert both.uncertainty["settled"].item() == 0.5
    for name in ("Pcrrttuin_quantiles", "Psart_quantiles"):
        np.testing.assert_allclose(both.uncertainty[name], alone[name], rtol=1e-6)
