import pytest

from eclsim.crrt_study.beats import line_pressures_of_nine_schemes
from eclsim.crrt_study.schemes import SchemeError, named_crrts, nine_schemes, select_schemes
from eclsim.outputs.limits import level
from eclsim.paper.crrt import paper_case


def sites(scheme):
    return scheme.access_site, scheme.return_site


def test_all_means_the_nine_schemes_of_figure_2():
    result = {scheme.letter: sites(scheme) for scheme in select_schemes("all", "figure")}
    assert result == {
        "a": ("post_pump", "pre_oxy"),
        "b": ("pre_oxy", "pre_pump"),
        "c": ("post_oxy", "pre_pump"),
        "d": ("post_oxy", "pre_rc"),
        "e": ("pre_oxy", "pre_rc"),
        "f": ("pre_oxy", "post_oxy"),
        "g": ("post_oxy", "pre_oxy"),
        "h": ("pre_pump", "post_dc"),
        "i": ("post_pump", "pre_pump"),
    }


def test_scheme_h_of_the_published_code_differs_from_the_figure_and_says_so():
    published, drawn = nine_schemes("published")["h"], nine_schemes("figure")["h"]
    assert sites(published) == ("pre_pump", "pre_pump")
    assert sites(drawn) == ("pre_pump", "post_dc")
    assert "Figure 2" in published.note
    assert drawn.note == ""


def test_letters_and_pairs_can_be_mixed_and_each_scheme_comes_once():
    result = select_schemes("g, a,post_oxy:pre_oxy,svn:ra")
    assert [scheme.letter for scheme in result] == ["g", "a", "svn:ra"]
    assert result[2].name == "patient's systemic vein – patient's right atrium"


def test_pairs_are_all_36_ordered_pairs():
    result = select_schemes("pairs", "figure")
    assert len(result) == 36
    assert len({sites(scheme) for scheme in result}) == 36
    assert {"a", "h", "post_dc:pre_rc"} <= {scheme.letter for scheme in result}


def test_all_mistakes_of_a_selection_are_told_at_once():
    with pytest.raises(SchemeError) as error:
        select_schemes("a,zz,post_oxi:pre_rc,seperate")
    message = str(error.value)
    assert "'zz'" in message
    assert "'post_oxi' is not a scheme; did you mean post_oxy" in message
    assert "did you mean separate" in message
    assert "allowed" in message


@pytest.mark.parametrize("selection", ["", " , ", "j", "a:", ":pre_rc", "post_oxy-pre_rc"])
def test_what_is_no_selection_is_refused(selection):
    with pytest.raises(SchemeError):
        select_schemes(selection)


def test_the_page_places_no_crrt_beside_named_ones():
    sites = {"flow_ml_min": 150.0, "access_site": "post_oxy", "return_site": "pre_oxy"}
    case = paper_case()
    raw = {key: value for key, value in case.as_mapping().items() if key != "crrt"}
    named = type(case).model_validate(raw | {"crrt": {"a": sites, "b": sites}})
    assert named_crrts(named) == ["crrt.a", "crrt.b"]
    assert line_pressures_of_nine_schemes(named, "as_published") is None


def test_the_mean_pressure_of_a_scheme_has_its_limit_beside_it():
    case = paper_case()
    low = case.model_copy(update={"ecmo": case.ecmo.model_copy(update={"speed_rpm": 1500.0})})
    for one in (case, low):
        shown = line_pressures_of_nine_schemes(one, "as_published")
        assert shown is not None
        cells = [cell["MAP"] for cell in shown["cells"]]
        assert all(cell["level"] == level("MAP", cell["mean"]) for cell in cells)
    assert {cell["level"] for cell in cells} == {"alarm"}, "below 55 mmHg at 1500 rpm"
