import numpy as np
import pytest

from eclsim.crrt_study.study import crrt_study
from eclsim.identification.posterior_samples import MOST, SamplesError, read_samples
from eclsim.paper.patient import paper_case


def test_samples_at_the_patient_give_certainty_and_wide_ones_do_not():
    samples = {"Dcrrttuout": [0.3175, 0.3175, 0.3175, 0.22, 0.2]}
    found = crrt_study(
        paper_case(), schemes="d,g", speeds="3425", volume_policy="as_published", samples=samples
    )
    doubt = found.uncertainty
    assert doubt.attrs["samples"] == 5
    median = doubt["Pcrrttuout_quantiles"].sel(quantile=0.5)
    np.testing.assert_allclose(median, found.means["Pcrrttuout"].sel(speed=3425.0).squeeze(), rtol=1e-6)
    kept = doubt["probability_kept"].sel(scheme="g")
    assert float(kept.sel(limit="access_alarm")) == 1.0
    assert float(kept.sel(limit="crrt")) == pytest.approx(float(kept.min()))
    assert float(kept.sel(limit="return_alarm")) == 0.6
    assert found.ranking["as_published"][0].letter == "d"


def test_samples_are_read_and_thinned(tmp_path):
    file = tmp_path / "samples.csv"
    file.write_text("Rmc, heart_rate_bpm\n" + "".join(f"{0.5 + k * 1e-4},90\n" for k in range(2 * MOST)))
    found = read_samples(file)
    assert set(found) == {"Rmc", "heart_rate_bpm"}
    assert len(found["Rmc"]) == MOST
    assert found["Rmc"][1] == pytest.approx(0.5002)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no samples"),
        ("Rmc\n", "no samples"),
        ("Rmd\n1\n", "'Rmd' is no parameter; did you mean"),
        ("Rmc,Rmc\n1,1\n", "twice"),
        ("Rmc\nhigh\n", ":2: Rmc is no number above 0"),
        ("Rmc\n0.5\n800\n", ":3: Rmc = 800: outside the allowed range; allowed: 0.02 to 8"),
        ("Rmc,Rsvn\n1\n", ":2: 1 values, the head has 2"),
    ],
)
def test_a_file_without_samples_is_refused(tmp_path, content, said):
    file = tmp_path / "samples.csv"
    file.write_text(content)
    with pytest.raises(SamplesError) as error:
        read_samples(file)
    assert said in str(error.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(SamplesError, match="no such file"):
        read_samples(tmp_path / "none.csv")
