"""Rows of a cohort that could not be used stand in the files of its fits."""

import csv
import json

from eclsim.cases.cohort import read_cohort
from eclsim.identification.files import fits_object, write_fits
from eclsim.identification.settings import FitSettings
from small_cohort import cohort


def test_a_refused_row_is_named_with_its_patient_in_the_json_and_the_verdicts(tmp_path):
    """The verdicts had no line for it, and the JSON did not say whose row it was."""
    table = tmp_path / "cohort.csv"
    table.write_bytes(cohort({}, {"patient_id": "P02", "SP": "high", "CO": "six"}))
    reading = read_cohort(table)
    write_fits(tmp_path, fits_object([], FitSettings().as_object(), reading), reading.refusals)
    refused = json.loads((tmp_path / "identification.json").read_text())["refused"]
    assert [(one["line"], one["patient_id"], one["column"]) for one in refused] == [
        (3, "P02", "SP"), (3, "P02", "CO"),
    ]  # fmt: skip
    (line,) = csv.DictReader((tmp_path / "verdicts.csv").read_text().splitlines())
    assert (line["id"], line["verdict"], line["level"], line["about"]) == ("line 3 (P02)", "refused", "", "")
    assert 'SP = "high": not a number' in line["sentence"]
    assert 'CO = "six": not a number' in line["sentence"]
