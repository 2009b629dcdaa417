"""The rows of dialysis: what was fitted is met, what was not is shown as it is."""

from eclsim.validation.dialysis import dialysis_check


def test_dilution_is_as_measured_and_the_misses_of_respiratory_dialysis_are_shown():
    check = dialysis_check()
    assert not check.required
    misses = [row for row in check.rows if not row.holds]
    assert all(row.explanation is not None for row in misses)
    assert not any(row.name.endswith("(fit)") for row in misses)
    carbon = [row for row in check.rows if row.name.startswith("CO2")]
    fit, blood, pressure = (row.got for row in carbon)
    assert abs(fit - 62.6) < 1e-6
    assert fit < blood < pressure, "more blood and more carbon dioxide remove more"
    assert all(row.explanation is not None for row in carbon[1:])


def test_more_effluent_clears_less_vancomycin_than_in_proportion():
    rows = {row.name: row for row in dialysis_check().rows if row.name.startswith("vancomycin")}
    fit, low, high = rows.values()
    assert abs(fit.got - 30.0) < 1e-6
    assert low.holds
    assert high.holds
    assert 1.0 < high.got / low.got < 0.9 * 40.0 / 25.0
