import pytest

from eclsim.devices.registry import UnknownParameterError, find_parameter, parameters
from eclsim.parameters import shi_hose2009, thiel2025
from eclsim.parameters.thiel2025 import BOUNDS

EVERY_PARAMETER = [p for p in parameters().values() if "Thiel" in p.source] + [
    *shi_hose2009.PARAMETERS.values()
]
PUBLISHED = [p.key for p in parameters().values() if "Thiel" in p.source]
TABLE_S1 = [
    *("etaB", "rhoB", "Rao", "Rsart", "Rmc", "Rsvn", "Rpas", "Rpart", "Rpmc", "Rpvn"),
    *("Cao", "Csart", "Csvn", "Cpas", "Cpart", "Cpvn", "Lao", "Lsart", "Lpas", "Lpart"),
    *("CQtri", "CQpa", "CQmi", "CQao", "Emaxra", "Edra", "Emaxrv", "RV_Pd_beta"),
    *("RV_Pd_kappa", "RV_Pd_alpha"),
    *("Emaxla", "Edla", "Emaxlv", "LV_Pd_beta", "LV_Pd_kappa", "LV_Pd_alpha"),
]


@pytest.mark.parametrize("parameter", EVERY_PARAMETER, ids=lambda parameter: parameter.key)
def test_every_parameter_says_what_it_is_and_its_default_is_allowed(parameter):
    for text in (parameter.unit, parameter.description, parameter.source, parameter.group):
        assert text.strip()
    assert parameter.minimum < parameter.maximum
    assert parameter.accepts(parameter.value)
    assert not parameter.accepts(float("nan"))
    assert not parameter.accepts(-1.0)


@pytest.mark.parametrize("key", [key for key in PUBLISHED if key[0] in "RCLED"])
def test_resistances_compliances_inertances_elastances_and_dimensions_cannot_be_zero(key):
    if not key.endswith("_beta"):
        assert parameters()[key].minimum > 0


def test_the_tables_are_complete():
    assert list(thiel2025.PARAMETERS)[: len(TABLE_S1)] == TABLE_S1
    groups = [parameters()[key].group for key in PUBLISHED]
    assert (groups.count("ecmo"), groups.count("crrt")) == (13, 11)


def test_shares_of_the_blood_volume_add_to_one():
    assert sum(thiel2025.PARAMETERS[key].value for key in thiel2025.VOLUME_FRACTIONS) == pytest.approx(
        1, abs=1e-9
    )


@pytest.mark.parametrize("key", BOUNDS)
def test_the_bounds_of_the_fit_lie_in_the_allowed_range(key):
    bounds, parameter = BOUNDS[key], parameters()[key]
    assert parameter.minimum <= bounds.lower < bounds.start < bounds.upper <= parameter.maximum
    assert bounds.start == parameter.value


def test_the_fitted_patient_lies_within_the_bounds():
    assert set(thiel2025.TABLE_S4) == set(BOUNDS)
    for key, value in thiel2025.TABLE_S4.items():
        assert BOUNDS[key].lower <= value <= BOUNDS[key].upper


def test_lookups():
    assert find_parameter("Rmc").value == 0.5
    assert find_parameter("ηB") is find_parameter("etaB")
    assert find_parameter("emaxLV").key == "Emaxlv"
    assert find_parameter("Compliance of systemic artery").key == "Csart"
    with pytest.raises(UnknownParameterError, match="did you mean Emaxlv"):
        find_parameter("Emaxl")
    with pytest.raises(UnknownParameterError, match=r"unknown parameter 'qqqq'$"):
        find_parameter("qqqq")


def test_the_mapping_of_all_parameters_cannot_be_changed():
    with pytest.raises(TypeError):
        parameters()["Rmc"] = parameters()["Rpmc"]  # type: ignore[index]
