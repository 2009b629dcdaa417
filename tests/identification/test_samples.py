"""Samples of parameters: what a posterior writes is read again, and what is no such table is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from eclsim.cases.case import Case, Patient
from eclsim.cases.regulation import Regulation
from eclsim.identification.draws import MOST_SAMPLES, SamplesError, doubts_of, read_samples, write_samples


def test_samples_are_read_and_thinned(tmp_path):
    file = tmp_path / "samples.csv"
    file.write_text(
        "Rmc, heart_rate_bpm\n" + "".join(f"{0.5 + k * 1e-4},90\n" for k in range(2 * MOST_SAMPLES))
    )
    result = read_samples(file)
    assert set(result) == {"Rmc", "heart_rate_bpm"}
    assert len(result["Rmc"]) == MOST_SAMPLES
    assert result["Rmc"][1] == pytest.approx(0.5002)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no samples"),
        ("Rmc\n", "no samples"),
        ("Rmd\n1\n", "'Rmd' is not a parameter; did you mean"),
        ("Rmc,Rmc\n1,1\n", "twice"),
        ("Rmc\nhigh\n", ":2: Rmc is not a number above 0"),
        ("Rmc\n0.5\n800\n", ":3: Rmc = 800: outside the allowed range; allowed: 0.02 to 8"),
        ("Rmc,Rsvn\n1\n", ":2: 1 values, the header has 2"),
    ],
)
def test_a_file_without_samples_is_refused(tmp_path, content, message):
    file = tmp_path / "samples.csv"
    file.write_text(content)
    with pytest.raises(SamplesError) as error:
        read_samples(file)
    assert message in str(error.value)


def test_the_message_of_an_empty_file_keeps_its_path(tmp_path):
    """A path with the words of the message was rewritten."""
    file = tmp_path / "no patients.csv"
    file.write_text("")
    with pytest.raises(SamplesError, match=re.escape(f"{file}: empty: no samples; needed: a header")):
        read_samples(file)


@pytest.mark.parametrize("name", ["none.csv", "none.nc"])
def test_a_file_that_is_not_there_is_refused(tmp_path, name):
    with pytest.raises(SamplesError, match="no such file"):
        read_samples(tmp_path / name)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_may_be_separated_as_spreadsheets_do(tmp_path, delimiter):
    file = tmp_path / "samples.csv"
    file.write_text(delimiter.join(("Rmc", "Rsvn")) + "\n" + delimiter.join(("0.5", "0.01")) + "\n")
    assert read_samples(file) == {"Rmc": [0.5], "Rsvn": [0.01]}


def test_a_decimal_comma_is_named(tmp_path):
    file = tmp_path / "samples.csv"
    file.write_text("Rmc;Rsvn\n0,5;0.01\n")
    with pytest.raises(SamplesError, match="'0,5' has a decimal comma; write a decimal point"):
        read_samples(file)


def test_what_is_written_is_read(tmp_path):
    draws = np.random.default_rng(0).uniform(0.3, 0.7, (2 * MOST_SAMPLES, 1))
    write_samples(("Rmc",), draws, tmp_path / "samples.csv")
    assert read_samples(tmp_path / "samples.csv")["Rmc"] == pytest.approx(draws[::2, 0].tolist(), rel=1e-7)


CASE = Case(patient=Patient(id="P01", sex="female", age_years=50, heart_rate_bpm=70))
TRUSTED = {"trusted": 1, "doubts": "", "id": "P01/2", "blood_volume_policy": "as_published"}


def posterior_file(folder: Path, form: str, about: dict[str, object]) -> Path:
    """The draws of a posterior as eclsim writes them, with what it says of itself."""
    if form == "csv":
        write_samples(("Rmc",), np.array([[0.8], [0.9]]), folder / "samples.csv")
        doubts = [text for text in str(about["doubts"]).split("; ") if text]
        content = about | {"trusted": bool(about["trusted"]), "doubts": doubts}
        (folder / "posterior.json").write_text(json.dumps(content))
        return folder / "samples.csv"
    group = xr.Dataset({"Rmc": (("chain", "draw"), [[0.8, 0.9]])}, attrs=about)
    xr.DataTree.from_dict({"posterior": group}).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    return folder / "posterior.nc"


@pytest.mark.parametrize("form", ["csv", "nc"])
@pytest.mark.parametrize(
    ("about", "said"),
    [
        ({}, ()),
        ({"trusted": 0, "doubts": "r_hat 1.4; POOR FIT"}, ("r_hat 1.4", "POOR FIT")),
        ({"trusted": 0}, ("nothing shows that its draws can be trusted",)),
        ({"id": "P02"}, ("its draws are those of patient 'P02', the case is that of 'P01'",)),
        ({"blood_volume_policy": "patient_held"}, ("fitted with the blood volume policy patient_held",)),
    ],
)
def test_samples_bring_the_doubts_of_their_posterior_and_whose_they_are(tmp_path, form, about, said):
    doubts = doubts_of(posterior_file(tmp_path, form, TRUSTED | about), CASE)
    assert bool(doubts) == bool(said)
    assert all(text in "\n".join(doubts) for text in said)


def test_a_table_of_ones_own_has_nothing_to_say_and_a_damaged_summary_is_no_trust(tmp_path):
    write_samples(("Rmc",), np.array([[0.8]]), tmp_path / "samples.csv")
    assert doubts_of(tmp_path / "samples.csv", CASE) == ()
    (tmp_path / "posterior.json").write_text("{")
    assert "cannot be read" in doubts_of(tmp_path / "samples.csv", CASE)[0]


def test_a_table_of_untrusted_draws_says_so_itself(tmp_path):
    """`samples.csv` taken away from its `posterior.json` was trusted."""
    file = tmp_path / "elsewhere.csv"
    write_samples(("Rmc", "Rsvn"), np.array([[0.8, 0.01], [0.9, 0.02]]), file, ("r_hat 1.4", "POOR FIT"))
    assert read_samples(file) == {"Rmc": [0.8, 0.9], "Rsvn": [0.01, 0.02]}
    assert doubts_of(file, CASE) == ("posterior: r_hat 1.4; POOR FIT",)


def reflex(**more):
    return Case(patient=CASE.patient, regulation=Regulation(baroreflex=1.0, **more))


@pytest.mark.parametrize("form", ["csv", "nc"])
@pytest.mark.parametrize(
    ("case", "said"),
    [
        (CASE, "its draws were fitted with reflexes, and the case has no [regulation]"),
        (reflex(), "its draws were fitted with regulation.set_point_mmHg = 90.8, which the case leaves open"),
        (reflex(set_point_mmHg=70.0), ""),
    ],
)
def test_draws_of_a_reflex_are_for_a_case_with_its_set_point(tmp_path, form, case, said):
    """The file that was fitted has no set point, the fitted case has: every draw got one of its own."""
    points = {"regulation.set_point_mmHg": 90.8, "regulation.venous_set_point_mmHg": 5.0}
    about = TRUSTED | {"set_points": points if form == "csv" else json.dumps(points)}
    doubts = doubts_of(posterior_file(tmp_path, form, about), case)
    assert len(doubts) == bool(said)
    assert all(text.startswith(f"posterior: {said}") for text in doubts)
