import pytest

from eclsim.cases import CaseError, apply_settings, read_case, read_mapping

MAPPING = {
    "format": 1,
    "patient": {"id": "P01", "sex": "female", "age_years": 70, "heart_rate_bpm": 120},
    "ecmo": {"pump": "Rotaflow", "speed_rpm": 3425, "oxygenator": "Quadrox-i Adult", "mode": "VA"},
    "parameters": {"Rmc": 0.5},
}


@pytest.fixture
def case():
    return read_mapping(MAPPING).case


def test_settings_change_sections_and_parameters(case):
    changed = apply_settings(
        case, ["ecmo.speed_rpm=3000", "Rmc=0.8", "patient.heart_rate_bpm = 90", "ecmo.pump=DP3"]
    )
    assert changed.ecmo.speed_rpm == 3000
    assert changed.ecmo.pump == "DP3"
    assert changed.patient.heart_rate_bpm == 90
    assert changed.parameters == {"Rmc": 0.8}
    assert case.ecmo.speed_rpm == 3425


def test_a_device_can_be_connected_and_a_roller_pump_chosen(case):
    changed = apply_settings(
        case, ["crrt.flow_ml_min=150", "crrt.access_site=post_oxy", "crrt.return_site=pre_oxy"]
    )
    assert changed.crrt.flow_ml_min == 150
    bare = {**MAPPING, "ecmo": {key: value for key, value in MAPPING["ecmo"].items() if key != "speed_rpm"}}
    bare["ecmo"]["pump"] = {"roller_l_min": 3.0}
    changed = apply_settings(read_mapping(bare).case, ["ecmo.pump={ roller_l_min = 4.5 }"])
    assert changed.ecmo.pump.roller_l_min == 4.5


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("ecmo.speed_rpm", "KEY=VALUE"),
        ("=3", "KEY=VALUE"),
        ("ecmo.sped_rpm=3000", "did you mean ecmo.speed_rpm?"),
        ("speed_rpm=3000", "ecmo.speed_rpm or lvad.speed_rpm"),
        ("Rmcc=1", "Rmc"),
        ("Rmc=-1", "--set: parameters.Rmc = -1: must be above 0"),
        ("Rmc=nan", "not a number"),
        ("Rmc=abc", "not a number"),
        ("Rmc=", "not given; a number is needed where the key is written"),
        ("patient.heart_rate_bpm=90 bpm", "write only the number [bpm]"),
        ("lvad.speed_rpm=3000", "lvad.pump: missing"),
    ],
)
def test_bad_settings_are_refused(case, setting, message):
    with pytest.raises(CaseError) as caught:
        apply_settings(case, [setting])
    assert message in str(caught.value)


def test_all_bad_settings_are_told_at_once(case):
    with pytest.raises(CaseError) as caught:
        apply_settings(case, ["a=1", "b=2", "Rmc=1"])
    assert len(caught.value.mistakes) == 2


def test_an_unknown_key_hides_no_other_mistake_of_settings_and_file(case, tmp_path):
    settings = ["ecmo.sped_rpm=3000", "Rmc=-1", "ecmo.pump=Rotflow"]
    with pytest.raises(CaseError) as caught:
        apply_settings(case, settings)
    assert [mistake.key for mistake in caught.value.mistakes] == [
        "ecmo.sped_rpm", "ecmo.pump", "parameters.Rmc"
    ]  # fmt: skip
    assert {mistake.file for mistake in caught.value.mistakes} == {"--set"}
    file = tmp_path / "case.toml"
    file.write_text('format = 1\n[patient]\nid = "P1"\nsex = "male"\nage_years = 500\nheart_rate_bpm = 80\n')
    with pytest.raises(CaseError) as caught:
        read_case(file, ["a=1", "Rmc", "Rmc=-1"])
    places = [(mistake.key, mistake.file, mistake.line) for mistake in caught.value.mistakes]
    assert places == [
        ("a", "--set", None), ("", "--set", None), ("parameters.Rmc", "--set", None),
        ("patient.age_years", str(file), 5),
    ]  # fmt: skip


def test_a_key_of_a_device_that_is_connected_twice_says_of_which(case):
    """It ended in a line for each key that a third one would need."""
    pump = {"pump": "HeartMate 3", "speed_rpm": 5400}
    sites = {"left": ("lv", "ao"), "right": ("rv", "pas")}
    two = {name: pump | {"inlet_site": a, "outlet_site": b} for name, (a, b) in sites.items()}
    both = read_mapping({**MAPPING, "lvad": two}).case
    with pytest.raises(CaseError) as error:
        apply_settings(both, ["lvad.speed_rpm=5000"])
    assert str(error.value) == (
        "--set: lvad.speed_rpm = 5000: the case has [lvad.left] and [lvad.right]; "
        "did you mean lvad.left.speed_rpm or lvad.right.speed_rpm?"
    )
    with pytest.raises(CaseError) as error:
        apply_settings(both, ["lvad.speed_rpm=5000", "lvad.left.speed_rpm=-1"])
    assert [mistake.key for mistake in error.value.mistakes] == ["lvad.speed_rpm", "lvad.left.speed_rpm"]
    events = [{"at_min": -1, "set": {"lvad.speed_rpm": 5000}}]
    with pytest.raises(CaseError) as error:
        read_mapping(both.as_mapping() | {"events": events})
    assert [mistake.key for mistake in error.value.mistakes] == [
        "events[1].at_min", "events[1].set.lvad.speed_rpm"
    ]  # fmt: skip
    assert apply_settings(both, ["lvad.left.speed_rpm=5000"]).setting("lvad.left", "speed_rpm") == 5000


def test_the_command_line_wins_over_the_file_and_says_so(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(
        'format = 1\n[patient]\nid = "P1"\nsex = "male"\nage_years = 50\nheart_rate_bpm = 80\n'
        "[parameters]\nRmc = 0.5\n"
    )
    reading = read_case(file, ["Rmc=0.8", "Csart=1", "Rmc=0.9"])
    assert reading.case.parameters == {"Rmc": 0.9, "Csart": 1.0}
    twice, note = [note for note in reading.notes if note.file == "--set"]
    assert "given more than once" in str(twice)
    assert str(note) == f"--set: parameters.Rmc = 0.9: overrides 0.5 of {file}"


def test_a_setting_given_twice_is_said(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(
        'format = 1\n[patient]\nid = "P01"\nsex = "female"\nage_years = 70\nheart_rate_bpm = 90\n',
        encoding="utf-8",
    )
    reading = read_case(file, ["Rmc=0.5", "Rmc=0.7"])
    assert reading.case.parameters["Rmc"] == 0.7
    (note,) = [str(n) for n in reading.notes if "Rmc" in str(n)]
    assert note == "--set: parameters.Rmc = 0.7: given more than once: overrides the earlier 0.5"
    assert not [n for n in read_case(file, ["Rmc=0.5", "Rmc=0.5"]).notes if "Rmc" in str(n)]


def test_a_value_without_quotes_is_shown_without_them(case):
    """`--set patient.heart_rate_bpm=fast` was answered with `= "fast"`."""
    with pytest.raises(CaseError) as caught:
        apply_settings(case, ["patient.heart_rate_bpm=fast", "ecmo.pump=Rotaflwo", "x=a b", 'y="a b"', "z"])
    subjects = [str(mistake).split(":")[1].strip() for mistake in caught.value.mistakes]
    assert subjects == ["x = a b", 'y = "a b"', "z", "patient.heart_rate_bpm = fast", "ecmo.pump = Rotaflwo"]
