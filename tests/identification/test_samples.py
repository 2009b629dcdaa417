"""Samples of parameters: what a posterior writes is read again, and what is no such table is refused."""

import numpy as np
import pytest

from eclsim.identification.samples import MOST, SamplesError, read_samples, write_samples


def test_samples_are_read_and_thinned(tmp_path):
    file = tmp_path / "samples.csv"
    file.write_text("Rmc, heart_rate_bpm\n" + "".join(f"{0.5 + k * 1e-4},90\n" for k in range(2 * MOST)))
    result = read_samples(file)
    assert set(result) == {"Rmc", "heart_rate_bpm"}
    assert len(result["Rmc"]) == MOST
    assert result["Rmc"][1] == pytest.approx(0.5002)


@pytest.mark.parametrize(
    ("content", "message"),
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
def test_a_file_without_samples_is_refused(tmp_path, content, message):
    file = tmp_path / "samples.csv"
    file.write_text(content)
    with pytest.raises(SamplesError) as error:
        read_samples(file)
    assert message in str(error.value)


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
    draws = np.random.default_rng(0).uniform(0.3, 0.7, (2 * MOST, 1))
    write_samples(("Rmc",), draws, tmp_path / "samples.csv")
    assert read_samples(tmp_path / "samples.csv")["Rmc"] == pytest.approx(draws[::2, 0].tolist(), rel=1e-7)
