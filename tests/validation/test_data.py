"""The embedded data are complete, consistent and say where they come from."""

import csv
import json

import numpy as np
import pytest

from eclsim.parameters.devices import CANNULAE, PUMPS
from eclsim.validation.cases import DATA, PAPER_PATIENT, case_names, reference_case
from eclsim.validation.reference_cases import QUICK, expected_results, explained

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


def test_an_exception_counts_only_if_the_published_laws_give_the_published_number():
    label = "s4_crrt_g_5000 Qpas max"
    assert explained(label, expected=5.449248, tolerance=2.0)
    assert not explained(label, expected=8.0, tolerance=2.0)
    assert not explained("s4_crrt_g_5000 Qpas min", expected=5.449248, tolerance=2.0)
