import pytest

from eclsim.identification.files import write_fit_figures
from eclsim.identification.fit import fit as fit_case
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.settings import FitSettings
from eclsim.identification.verdict import Aspect, Level, Reason

QUICK = FitSettings(("Rmc", "Emaxlv"), multi_start=MultiStart(10, 0.2, round_size=4, rediscoveries=2))


@pytest.mark.slow
def test_every_figure_names_the_patient_and_a_verdict_that_is_not_good(twin, tmp_path):
    fit = fit_case(twin, settings=QUICK)
    write_fit_figures(tmp_path / "good", fit, None)
    doubtful = fit.judged([Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", "no such patient")])
    write_fit_figures(tmp_path / "doubtful", doubtful, None)
    for name in ("slices", "starts", "residuals", "correlation"):
        good, doubted = ((tmp_path / of / f"{name}.svg").read_text() for of in ("good", "doubtful"))
        assert ">T01 – fit<" in good
        assert ">T01 – fit<" in doubted
        assert "DOUBTFUL" in doubted
        assert "DOUBTFUL" not in good
