import numpy as np
import pytest

from eclsim.crrt_study.study import crrt_study
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
    assert result.ranking["as_published"][0].letter == "d"
