import csv
import json
import re
from dataclasses import replace
from html import escape
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr

import eclsim
from crrt_failures import forget, with_failures
from eclsim.cases.reading import read_mapping
from eclsim.crrt_study.files import MEANS, file_names, study_object, tables, write_netcdf, write_study
from eclsim.crrt_study.report import drawings, show, study_page


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


@pytest.mark.slow
def test_the_page_asks_nothing_of_the_network(folder, report):
    source = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://", source)
    assert {tag for tag, _ in report.tags} & {"script", "link", "img", "iframe", "object"} == set()
    for tag, attributes in report.tags:
        for name in ("src", "href", "xlink:href"):
            assert str(attributes.get(name, "#")).startswith("#"), (tag, attributes)


@pytest.mark.slow
def test_a_hostile_id_stays_text(report):
    assert "script" not in {tag for tag, _ in report.tags}
    assert any("<script>alert('x')</script>" in text for text in report.words)


@pytest.mark.slow
def test_names_inside_the_drawings_are_unique(report):
    assert len(report.ids) == len(set(report.ids)) > 20


@pytest.mark.slow
def test_the_page_tells_answer_schemes_limits_policies_and_assumptions(report, hostile_study):
    text = " ".join(report.words)
    best = hostile_study.ranking["as_published"][0]
    assert f"First choice for this patient: scheme {best.letter}" in text
    for message in ("What was assumed", "circuits are primed", "190 mmHg", "not a medical device", "Sansom"):
        assert message in text
    assert "both lines at pre pump, as in the published code" in text
    assert sum(tag == "svg" for tag, _ in report.tags) == 5


@pytest.mark.slow
def test_json_has_the_agreed_form(hostile_study, folder):
    result = json.loads((folder / "study.json").read_text())
    assert result.pop("made_by") == f"eclsim {eclsim.__version__}"
    assert result == json.loads(json.dumps(study_object(hostile_study)))
    with xr.open_dataset(folder / "study.nc", engine="h5netcdf") as root:
        assert json.loads(root.attrs["case"]) == result["case"]
        assert read_mapping(result["case"]).case == hostile_study.case
        assert root.attrs["warnings"].splitlines() == result["warnings"] != []
        assert root.attrs["converged"] == result["converged"]
    policy = result["policies"]["as_published"]
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
    assert result["policies"]["patient_held"]["schemes"]["a"]["patient_volume_change_ml"] == pytest.approx(
        0.0, abs=1e-9
    )
    assert "difference_to_no_crrt" not in result["policies"]["patient_held"]["schemes"]["a"]


@pytest.mark.slow
def test_tables_have_units_and_a_row_for_each_point(folder):
    with (folder / "means.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 4
    assert {"Psart [mmHg]", "PF [L/min]", "speed [rpm]", "patient_volume_change [mL]"} <= set(rows[0])
    with (folder / "limits.csv").open() as file:
        assert "largest_flow [L/min]" in next(csv.reader(file))


@pytest.mark.slow
def test_netcdf_holds_all_groups_with_units(hostile_study, folder):
    path = folder / "study.nc"
    for group, variable, unit in (
        ("means", "Pcrrttuin", "mmHg"),
        ("waveforms", "Vrv", "mL"),
        ("without_crrt", "PF", "L/min"),
        ("limits", "margin", "mmHg"),
        ("uptake", "blood_taken_up", "mL"),
        ("uptake", "Psart_flow", "mmHg"),
        ("uptake", "CO_difference", "L/min"),
    ):
        with xr.open_dataset(path, group=group, engine="h5netcdf") as data:
            assert data[variable].attrs["units"] == unit
    with xr.open_dataset(path, group="means", engine="h5netcdf") as data:
        np.testing.assert_array_equal(data["Psart"], hostile_study.means["Psart"])


DRAWN = dict.fromkeys(("schemes", "beat", "speeds", "limits", "uptake"), "<svg></svg>")


def words_of(page: str) -> str:
    parsed = Page()
    parsed.feed(page)
    return " ".join(" ".join(parsed.words).split())


DOUBT = "its parameters are a DOUBTFUL fit of eclsim identify: see why in its report"


@pytest.fixture(scope="module")
def doubtful_study(hostile_study):
    return replace(hostile_study, warnings=(DOUBT, *hostile_study.warnings))


@pytest.mark.slow
def test_the_doubt_about_a_fit_stands_before_the_first_choice(hostile_study, doubtful_study):
    text = words_of(study_page(doubtful_study, DRAWN))
    assert text.index(DOUBT) < text.index("First choice for this patient")
    assert "in doubt" not in words_of(study_page(hostile_study, DRAWN))


@pytest.mark.slow
def test_every_table_of_a_doubtful_fit_says_so(hostile_study, doubtful_study):
    for name, table in tables(doubtful_study).items():
        assert set(table["doubts"]) == {DOUBT}, name
    assert not any("doubts" in table for table in tables(hostile_study).values())


@pytest.mark.slow
def test_every_figure_names_the_patient_and_the_doubt(doubtful_study):
    for name, svg in drawings(doubtful_study).items():
        assert DOUBT in svg, name
        assert escape("<script>alert('x')</script>", quote=False) in svg, name


@pytest.mark.slow
def test_an_unsettled_point_is_named_on_the_page_in_json_and_in_tables(hostile_study, tmp_path):
    gone = with_failures(hostile_study, [("patient_held", "g", 5000.0)])
    text = words_of(study_page(gone, DRAWN))
    assert "Not all steady states were found" in text
    assert "Scheme g, patient's volume held: no steady beat at 5000 rpm (the native heart ejects" in text
    assert f"First choice for this patient: scheme {gone.ranking['as_published'][0].letter}" in text
    result = study_object(gone)
    assert [one["of"] for one in result["not_known"]] == ["scheme g"]
    assert result["not_known"][0]["speeds_rpm"] == [5000.0]
    held = result["policies"]["patient_held"]
    assert held["limits"]["schemes"]["g"]["return_alarm"]["state"] == "not_known_above"
    assert held["speeds"][-1]["schemes"]["g"] == {
        "converged": False,
        "status": "no_ejection",
    } | dict.fromkeys(MEANS)
    assert held["speeds"][-1]["summary"]["schemes_known"] == 2
    json.dumps(result, allow_nan=False)
    rows = tables(gone)
    assert rows["means"]["status"].tolist().count("no_ejection") == 1
    write_netcdf(gone, tmp_path / "study.nc")
    with xr.open_dataset(tmp_path / "study.nc", group="means", engine="h5netcdf") as data:
        assert np.isin(data["status"].values, ["no_ejection"]).sum() == 1
        assert np.isnan(data["Psart"].values).sum() == 1


@pytest.mark.slow
def test_no_first_choice_is_named_where_a_scheme_has_no_beat_at_the_speed_of_the_case(hostile_study, capsys):
    gone = with_failures(hostile_study, [("as_published", "g", 3425.0)], "not_converged")
    text = words_of(study_page(gone, DRAWN))
    assert "First choice" not in text
    assert "No first choice can be named; best of the 2 of 3 schemes whose beat was found at 3425 rpm" in text
    assert "Scheme g: no place: no steady beat at 3425 rpm (the search for it did not converge)" in text
    assert "median of 2 of 3" in text
    policy = study_object(gone)["policies"]["as_published"]
    assert policy["first_choice"] is None
    assert policy["ranking"][-1]["rank"] is None
    assert tables(gone)["ranking"]["rank"].isna().sum() == 1
    show(gone)
    assert "No first choice can be named" in capsys.readouterr().out


@pytest.mark.slow
def test_the_page_warns_where_only_the_beats_without_crrt_failed(hostile_study):
    single = hostile_study.without_crrt.copy(deep=True)
    single["status"] = single["status"].astype(object)
    forget(single, {"policy": "as_published", "speed": 3425.0}, "not_converged")
    uptake = hostile_study.uptake.drop_vars("status") * np.nan
    uptake["status"] = ("scheme", ["not_computed"] * 3)
    gone = replace(hostile_study, without_crrt=single, uptake=uptake)
    text = words_of(study_page(gone, DRAWN))
    assert "Without CRRT, as published: no steady beat at 3425 rpm (the search" in text
    assert "Not known: no steady beat of the patient without CRRT, or of any scheme, was found" in text
    assert not re.search(r"\bnan\b", text)


@pytest.mark.slow
def test_how_sure_it_is_tells_the_share_of_samples_with_a_beat(hostile_study):
    limits = ["access_alarm", "return_alarm", "access_190", "suction", "crrt"]
    share, spread = np.full((3, 5), 0.9), np.full((3, 3), 100.0)
    data = {f"probability_{word}": (("scheme", "limit"), share + more)
            for word, more in (("kept", 0.0), ("at_least", -0.09), ("at_most", 0.01))}  # fmt: skip
    data |= {
        f"{name}_quantiles": (("scheme", "quantile"), spread) for name in ("Psart", "Pcrrttuin", "Pcrrttuout")
    }
    data["settled"] = ("scheme", [0.9, 1.0, 0.996])
    doubt = xr.Dataset(data, {"scheme": list("agh"), "limit": limits, "quantile": [0.05, 0.5, 0.95]})
    doubt.attrs = {"blood_volume_policy": "as_published", "samples": 1000, "speed_rpm": 3425.0}
    text = words_of(study_page(replace(hostile_study, uncertainty=doubt), DRAWN))
    assert "81 to 91 %" in text
    assert "> 99 %" in text
    assert (
        "Samples of the patient's parameters without a steady beat that a patient can have, of 1000: "
        "100 (scheme a), 4 (scheme h)" in text
    )
