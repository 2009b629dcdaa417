"""The rows of dialysis: what was fitted is met, what was not is shown as it is."""

from eclsim.validation.dialysis import dialysis_check


def test_dilution_is_as_measured_and_the_misses_of_respiratory_dialysis_are_shown():
    check = dialysis_check()
    assert not check.required
    misses = [row.name for row in check.rows if not row.holds]
    assert misses == [name for name in misses if name.endswith("(test)")]
    carbon = [row for row in check.rows if row.name.startswith("CO2")]
    fit, blood, pressure = (row.got for row in carbon)
    assert abs(fit - 62.6) < 1e-6
    assert fit < blood < pressure, "more blood and more carbon dioxide remove more"
    assert all(row.explanation is not None for row in carbon[1:])
