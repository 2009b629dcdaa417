import csv
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr

from eclsim.report.crrt_files import file_names, write_study
from eclsim.report.crrt_json import study_object


@pytest.fixture(scope="module")
def folder(hostile_study, tmp_path_factory):
    target = tmp_path_factory.mktemp("out") / "study"
    written = write_study(hostile_study, target)
    assert {path.name for path in written} == set(file_names())
    return target


class Page(HTMLParser):
    """Collects tags, ids and words of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.ids, self.words = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def report(folder):
    parsed = Page()
    parsed.feed((folder / "report.html").read_text(encoding="utf-8"))
    return parsed


def test_the_page_asks_nothing_of_the_network(folder, report):
    source = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://", source)
    assert {tag for tag, _ in report.tags} & {"script", "link", "img", "iframe", "object"} == set()
    for tag, attributes in report.tags:
        for name in ("src", "href", "xlink:href"):
            assert str(attributes.get(name, "#")).startswith("#"), (tag, attributes)


def test_a_hostile_id_stays_text(report):
    assert "script" not in {tag for tag, _ in report.tags}
    assert any("<script>alert('x')</script>" in words for words in report.words)


def test_names_inside_the_drawings_are_unique(report):
    assert len(report.ids) == len(set(report.ids)) > 20


def test_the_page_tells_answer_schemes_limits_policies_and_assumptions(report, hostile_study):
    words = " ".join(report.words)
    best = hostile_study.ranking["as_published"][0]
    assert f"First choice for this patient: scheme {best.letter}" in words
    for said in ("What was assumed", "circuits are primed", "190 mmHg", "not a medical device", "Sansom"):
        assert said in words
    assert "both lines at pre pump, as in the published code" in words
    assert sum(tag == "svg" for tag, _ in report.tags) == 5


def test_json_has_the_agreed_form(hostile_study, folder):
    found = json.loads((folder / "study.json").read_text())
    assert found == json.loads(json.dumps(study_object(hostile_study)))
    policy = found["policies"]["as_published"]
    assert policy["speed_rpm"] == 3425
    assert set(policy["schemes"]) == {"a", "g", "h"}
    scheme = policy["schemes"]["a"]
    assert (scheme["access_site"], scheme["return_site"]) == ("post_pump", "pre_oxy")
    pressures = ["Psart", "Psvn", "Ppart", "Pcrrttuin", "Pcrrttuout", "Pecmodrain", "MAP"]
    names = [*pressures, "PF", "CO", "EDVRV", "ESVRV"]
    assert all(np.isfinite(scheme["means"][name]) for name in names)
    assert scheme["patient_volume_change_ml"] == pytest.approx(-88.8, abs=0.5)
    assert policy["summary"]["Psart"]["variation"] == pytest.approx(
        policy["schemes"]["h"]["means"]["Psart"] - scheme["means"]["Psart"]
    )
    assert [one["speed_rpm"] for one in policy["speeds"]] == [1000, 3000, 3425, 5000]
    assert policy["limits"]["schemes"]["a"]["access_190"]["largest_ecmo_flow_l_min"] == pytest.approx(
        4.0, abs=0.1
    )
    assert found["policies"]["patient_held"]["schemes"]["a"]["patient_volume_change_ml"] == pytest.approx(
        0.0, abs=1e-9
    )
    assert "difference_to_no_crrt" not in found["policies"]["patient_held"]["schemes"]["a"]


def test_tables_have_units_and_a_row_for_each_point(folder):
    with (folder / "means.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 4
    assert {"Psart [mmHg]", "PF [L/min]", "speed [rpm]", "patient_volume_change [mL]"} <= set(rows[0])
    with (folder / "limits.csv").open() as file:
        assert "largest_flow [L/min]" in next(csv.reader(file))


def test_netcdf_holds_all_groups_with_units(hostile_study, folder):
    path = folder / "study.nc"
    for group, variable, unit in (
        ("means", "Pcrrttuin", "mmHg"),
        ("waveforms", "Vrv", "mL"),
        ("without_crrt", "PF", "L/min"),
        ("limits", "margin", "mmHg"),
        ("uptake", "blood_taken_up", "mL"),
    ):
        with xr.open_dataset(path, group=group, engine="h5netcdf") as data:
            assert data[variable].attrs["units"] == unit
    with xr.open_dataset(path, group="means", engine="h5netcdf") as data:
        np.testing.assert_array_equal(data["Psart"], hostile_study.means["Psart"])


def test_an_unsettled_point_is_named_on_the_page(hostile_study):
    from dataclasses import replace

    from eclsim.report.crrt_html import study_page

    means = hostile_study.means.copy(deep=True)
    means["converged"].loc[{"policy": "patient_held", "scheme": "g", "speed": 5000.0}] = False
    drawn = dict.fromkeys(("schemes", "beat", "speeds", "limits", "uptake"), "<svg></svg>")
    page = study_page(replace(hostile_study, means=means), drawn)
    assert "No steady beat was found" in page
    assert "patient_held, scheme g, 5000 rpm" in page
