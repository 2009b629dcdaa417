"""The embedded data are complete, consistent and say where they come from."""

import csv
import json

import numpy as np
import pytest

from eclsim.devices import ecmo, lvad
from eclsim.devices.cannulae import CANNULAE
from eclsim.validation.reference_cases import (
    DATA,
    PAPER_PATIENT,
    QUICK,
    SHARE_OF_RANGE,
    WAVEFORM_ABSOLUTE,
    case_names,
    expected_results,
    explanation,
    reference_case,
)

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}
TABLES = sorted(path.name for path in DATA.glob("*.csv"))


def table(name: str) -> list[dict[str, str]]:
    with (DATA / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_case_has_expected_results_and_the_other_way_round():
    assert len(case_names()) == 26
    assert set(case_names()) == set(expected_results())
    assert {PAPER_PATIENT, *QUICK} <= set(case_names())


@pytest.mark.parametrize("name", case_names())
def test_case_is_read_and_is_called_what_its_file_is(name: str):
    case = reference_case(name)
    assert case.patient.id == name
    assert ("PF" in expected_results()[name]["outputs"]) == (case.ecmo is not None)


def test_statistics_of_the_reference_are_ordered():
    for case in expected_results().values():
        for numbers in case["waveforms"].values():
            assert numbers["min"] <= numbers["mean"] + 1e-6
            assert numbers["mean"] <= numbers["max"] + 1e-6


def test_elasticities_of_the_published_code_agree_with_its_own_reverse_mode():
    for case in json.loads((DATA / "gradients.json").read_text(encoding="utf-8")).values():
        differences, reverse = np.array(case["elasticity_fd"]), np.array(case["elasticity_ad"])
        assert differences.shape == (len(case["outputs"]), len(case["params"]))
        largest = np.abs(differences).max(axis=1, keepdims=True)
        assert np.all(np.abs(differences - reverse) < 0.05 * largest)


@pytest.mark.parametrize("name", TABLES)
def test_every_row_of_a_table_is_whole(name: str):
    rows = table(name)
    assert rows
    assert all(None not in row and None not in row.values() for row in rows)


@pytest.mark.parametrize("name", ["devices.csv", "healthy_adult.csv", "effects.csv"])
def test_measurements_name_their_source(name: str):
    assert all(row["source"] and row["how_read"] for row in table(name))


def test_devices_of_the_bench_data_exist():
    assert {row["device"] for row in table("devices.csv")} <= {*PUMPS, *CANNULAE}


def test_every_file_is_described():
    readme = (DATA / "README.md").read_text(encoding="utf-8")
    names = [path.name for path in DATA.iterdir() if path.suffix in (".csv", ".json")]
    assert [name for name in names if f"`{name}`" not in readme] == []


def tolerance(statistic: str) -> tuple[float, float]:
    """Expected number of a statistic of a waveform, and its tolerance."""
    case, signal, kind = statistic.split()
    numbers = expected_results()[case]["waveforms"][signal]
    return numbers[kind], max(
        SHARE_OF_RANGE * (numbers["max"] - numbers["min"]), WAVEFORM_ABSOLUTE[signal[0]]
    )


@pytest.mark.parametrize("row", table("published_laws.csv"), ids=lambda row: row["statistic"])
def test_an_exception_counts_only_for_the_number_it_was_shown_for(row: dict[str, str]):
    statistic, own = row["statistic"], float(row["eclsim"])
    expected, allowed = tolerance(statistic)
    shown = explanation(statistic, expected, own, allowed)
    assert shown is not None
    assert shown.holds
    for got in (own + 0.5 * allowed, own - 0.5 * allowed, own - 50.0, float("nan")):
        regressed = explanation(statistic, expected, got, allowed)
        assert regressed is not None
        assert not regressed.holds
    other = explanation(statistic, expected + allowed, own, allowed)
    assert other is not None
    assert not other.holds


def test_a_statistic_that_the_published_laws_were_not_tried_for_has_no_explanation():
    assert explanation("s4_crrt_g_5000 Qpas min", 0.0, 1.0, 2.0) is None
