"""Every kind of bad input that a case file can hold gets its verdict; numbers name its row in the list."""

import re
from typing import NamedTuple

import pytest

from eclsim.cases import CaseError, read_case

PATIENT = """format = 1
[patient]
id = "P01"
sex = "female"
age_years = 70
height_cm = 165
weight_kg = 60
heart_rate_bpm = 120
"""
ECMO = """[ecmo]
pump = "Rotaflow"
speed_rpm = 3425
oxygenator = "Quadrox-i Adult"
drainage_site = "ra"
drainage_cannula = "venous"
drainage_fr = 21
return_site = "ao"
return_cannula = "arterial"
return_fr = 17
"""
CRRT = """[crrt]
flow_ml_min = 200
access_site = "post_oxy"
return_site = "pre_oxy"
"""
LVAD = """[lvad]
pump = "HVAD"
speed_rpm = 2600
inlet_site = "lv"
outlet_site = "ao"
"""
MEASURED = """[measurements]
SP = 83
DP = 76
MAP = 79
MPAP = 11
CO = 1.4
PF = 3.5
"""
FULL = PATIENT + MEASURED + ECMO + CRRT


class Row(NamedTuple):
    """One bad input: what is changed in a good file, the verdict and the words that must be said."""

    number: int
    base: str
    change: dict[str, str]
    verdict: str
    says: tuple[str, ...] = ()

    def text(self) -> str:
        lines = []
        done = set()
        for line in self.base.splitlines():
            key = line.partition("=")[0].strip()
            if key in self.change and key not in done:
                done.add(key)
                line = f"{key} = {self.change[key]}" if self.change[key] else ""
            lines.append(line)
        return "\n".join([*lines, *(self.change[key] for key in self.change if key not in done)]) + "\n"


def add(text: str) -> dict[str, str]:
    """Lines at the end of the file."""
    return {"the end": text}


def parameter(name: str, value: str) -> dict[str, str]:
    return add(f"[parameters]\n{name} = {value}")


ROWS = [
    Row(1, FULL, {"SP": "76", "DP": "83"}, "E", ("measurements.SP", "76", "83", "swapped")),
    Row(2, FULL, {"MAP": "90"}, "E", ("measurements.MAP", "SP 83", "DP 76", "MAP 90")),
    Row(2, FULL, {"MAP": "70"}, "E", ("SP 83", "DP 76", "MAP 70")),
    Row(3, FULL, {"SP": "120", "DP": "60", "MAP": "110"}, "W", ("measurements.MAP = 110", "80 mmHg")),
    Row(4, FULL, {"SP": "80", "DP": "80", "MAP": "80"}, "OK"),
    Row(4, PATIENT + MEASURED, {"SP": "80", "DP": "80", "MAP": "80", "PF": ""}, "W", ("no pulse",)),
    Row(6, FULL, {"CO": "3400"}, "E", ("3400 mL/min = 3.4 L/min", "0 to 20 L/min")),
    Row(6, FULL, {"CO": "56"}, "E", ("56 mL/s = 3.36 L/min",)),
    Row(7, FULL, {"PF": "58"}, "E", ("58 mL/s = 3.48 L/min",)),
    Row(7, FULL, {"PF": "0.21"}, "W", ("measurements.PF = 0.21", "3425 rpm")),
    Row(7, FULL, {"PF": "3.5", "speed_rpm": "1000"}, "W", ("implausible at 1000 rpm",)),
    Row(8, FULL, {"MPAP": '"15 cmH2O"'}, "E", ("cmH2O", "11.03 mmHg")),
    Row(8, FULL, {"MPAP": '"2 kPa"'}, "E", ("kPa", "15 mmHg")),
    Row(10, FULL, {"height_cm": "60", "weight_kg": "165"}, "W", ("458", "likely swapped")),
    Row(11, FULL, {"age_years": "-3"}, "E", ("patient.age_years = -3", "18 to 100 years")),
    Row(11, FULL, {"age_years": "0"}, "E", ("18 to 100 years",)),
    Row(11, FULL, {"age_years": "0.5"}, "E", ("18 to 100 years",)),
    Row(11, FULL, {"age_years": "140"}, "E", ("18 to 100 years",)),
    Row(11, FULL, {"age_years": '"70 y"'}, "E", ("18 to 100 years", "did you mean 70")),
    Row(11, FULL, {"age_years": "70 y"}, "E", ("write only the number [years]", "did you mean 70")),
    Row(13, FULL, {"heart_rate_bpm": "195"}, "W", ("faster than a sinus node of", "arrhythmia")),
    Row(13, FULL, {"heart_rate_bpm": "0"}, "E", ("20 to 250 bpm",)),
    Row(13, FULL, {"heart_rate_bpm": "-60"}, "E", ("20 to 250 bpm",)),
    Row(13, FULL, {"heart_rate_bpm": "400"}, "E", ("20 to 250 bpm",)),
    Row(13, FULL, {"heart_rate_bpm": "1.2"}, "E", ("1.2 Hz = 72 bpm",)),
    Row(14, PATIENT + MEASURED + "PCWP = 20\n" + ECMO, {}, "W", ("measurements.PCWP = 20", "11 mmHg")),
    *(
        Row(15, FULL, {"MPAP": value}, "OK", ("measurements.MPAP", "not fitted"))
        for value in ("nan", '"nan"', '"NA"', '"-"', '"n/a"', '"."', '""', '"#N/A"')
    ),
    Row(17, FULL, {"MPAP": "inf"}, "E", ("infinite",)),
    Row(17, FULL, {"MPAP": "-inf"}, "E", ("infinite",)),
    Row(17, FULL, {"MPAP": "1e400"}, "E", ("1e400", "too large")),
    Row(17, FULL, {"MPAP": "1e-400"}, "E", ("1e-400", "too small")),
    Row(17, FULL, {"heart_rate_bpm": "nan"}, "E", ("patient.heart_rate_bpm",)),
    Row(17, FULL, {"heart_rate_bpm": "1" + "0" * 400}, "E", ("too large",)),
    Row(17, FULL, {"heart_rate_bpm": "1" + "0" * 5000}, "E"),
    Row(19, FULL, {"SP": '"120/80"'}, "E", ("SP = 120 and DP = 80",)),
    Row(19, FULL, {"SP": "120/80"}, "E", ("SP = 120 and DP = 80",)),
    Row(21, FULL, {"PF": '"3,5"'}, "E", ("decimal comma", "3.5")),
    Row(21, FULL, {"PF": "3,5"}, "E", ("decimal comma", "did you mean 3.5")),
    Row(21, FULL, {"PF": '"3,425"'}, "E", ("decimal comma", "did you mean 3.425")),
    Row(21, FULL, {"speed_rpm": '"2,725"'}, "E", ("thousands separator", "did you mean 2725?")),
    Row(21, FULL, {"speed_rpm": "2,725"}, "E", ("thousands separator", "did you mean 2725?")),
    Row(21, FULL, {"PF": '"1.234,5"'}, "E", ("thousands",)),
    Row(21, FULL, {"PF": '"1,234.5"'}, "E", ("thousands",)),
    Row(23, PATIENT + "[measurements]\nMAPP = 80\n", {}, "E", ("measurements.MAPP", "MAP")),
    Row(23, PATIENT + "[measurements]\nmap = 80\n", {}, "E", ("measurements.map", "did you mean MAP?")),
    Row(23, PATIENT + f"[measurements]\n{'M' * 30} = 80\n", {}, "E", ("M" * 30,)),
    Row(23, FULL, add("[parameter]\nRmc = 0.6"), "E", ("did you mean parameters",)),
    Row(24, FULL, {"heart_rate_bpm": "", "sex": ""}, "E", ("heart_rate_bpm: missing", "sex: missing")),
    Row(24, "format = 1\n" + ECMO, {}, "E", ("patient: this section is missing", "heart_rate_bpm")),
    Row(24, FULL, {"drainage_fr": "", "return_site": ""}, "E", ("ecmo.drainage_fr", "ecmo.return_site")),
    Row(24, FULL, {"height_cm": ""}, "E", ("patient.height_cm", "both, or neither")),
    Row(27, FULL, {}, "OK", ("measurements.CO = 1.4", "native", "the organs get 4.9 L/min")),
    Row(27, FULL, {"CO": "4.9"}, "W", ("native", "5.8 mL/mmHg", "did you mean CO = 1.4, a total")),
    Row(27, FULL, {"CO": "8.5"}, "W", ("12 L/min, 7.2 L/min/m^2", "did you mean CO = 5")),
    Row(
        27, FULL, {"drainage_site": '"svn"', "return_site": '"ra"'}, "W",
        ("measurements.CO = 1.4: below the pump flow 3.5 L/min", "before the lungs"),
    ),
    Row(
        27, FULL, {"return_site": '"la"'}, "W",
        ("measurements.CO = 1.4", "the organs get 4.9 L/min", "returns to left atrium", 'did you mean "ra"?'),
    ),
    Row(51, FULL, parameter("Csart", "0"), "E", ("parameters.Csart = 0", "above 0", "0.02 to 20")),
    Row(51, FULL, parameter("Csart", "-0.9"), "E", ("above 0", "0.02 to 20 mL/mmHg")),
    Row(51, FULL, parameter("Csart", "1e-12"), "E", ("0.02 to 20 mL/mmHg",)),
    Row(52, FULL, parameter("Rmc", "8.3"), "E", ("8.3 Wood units = 0.498 mmHg s/mL",)),
    Row(52, FULL, parameter("Rmc", "800"), "E", ("800 dyn s/cm^5 = 0.6 mmHg s/mL",)),
    Row(52, FULL, parameter("Rmc", '"800 dyn.s/cm5"'), "E", ("0.6 mmHg s/mL",)),
    Row(52, FULL, parameter("Rmc", "7"), "W", ("parameters.Rmc = 7", "Wood units")),
    Row(53, FULL, parameter("Rmcc", "0.5"), "E", ("parameters.Rmcc", "Rmc")),
    Row(53, FULL, parameter("heart_rate_bpm", "90"), "E", ("patient.heart_rate_bpm",)),
    Row(
        62, FULL, {"return_fr": '17\nmode = "VV"'}, "E", ('contradicts return_site = "ao" (aorta)',)
    ),
    Row(51, FULL, parameter("P0svn", "150"), "E", ("3548 mL of a blood volume of 3417 mL",)),
    Row(51, FULL, parameter("P0svn", "80"), "W", ("stressed volume is 2113 mL", "62 %")),
    Row(51, FULL, parameter("P0svn", "0"), "W", ("0 mL in the systemic veins (82 as published)",)),
    Row(51, FULL, parameter("Csart", "9"), "W", ("720 mL, more than the 324 mL",)),
    Row(51, FULL, parameter("Emaxla", "0.1"), "W", ("Edla = 0.2125 is above Emaxla = 0.1 mmHg/mL",)),
    Row(51, FULL, parameter("Edra", "0.5"), "W", ("right atrium is stiffer at rest",)),
    Row(
        59, FULL, add("[parameters]\nvolume_fraction_svn = 0.6\nvolume_fraction_capillaries = 0.11"), "W",
        ("volume_fraction_svn = 0.6: without effect on pressures and flows",),
    ),
    Row(
        64, FULL, {"pump": "{ roller_l_min = 0.4 }", "speed_rpm": "", "flow_ml_min": "500", "PF": "0.5"}, "W",
        ("crrt.flow_ml_min = 500: above the ECMO flow 0.4 L/min",),
    ),
    Row(53, FULL, parameter("rmc", "0.5"), "E", ("did you mean Rmc?",)),
    Row(57, FULL, parameter("CQao", "0"), "E", ("parameters.CQao = 0", "1 to 5000")),
    Row(59, FULL, parameter("volume_fraction_lv", "0.1"), "E", ("add to 1.07125",)),
    Row(61, FULL, {"return_site": '"ra"'}, "E", ("ecmo.return_site", "drainage_site")),
    Row(63, FULL, {"access_site": "9"}, "E", ("crrt.access_site = 9", "post_oxy", "pre_rc")),
    Row(63, FULL, {"access_site": "21"}, "E", ("post_oxy",)),
    Row(63, FULL, {"access_site": "-1"}, "E", ("post_oxy",)),
    Row(63, FULL, {"access_site": "3.5"}, "E", ("post_oxy",)),
    Row(63, PATIENT + CRRT, {}, "E", ("no [ecmo] section",)),
    Row(65, FULL, {"drainage_site": '"ao"', "return_site": '"ra"'}, "W", ("shunt", "reversed")),
    *(
        Row(
            65, FULL.replace('"pre_oxy"', f'"{site}"'), {}, "W",
            ("crrt.return_site", "systemic embolism", words),
        )
        for site, words in {
            "la": "left atrium", "lv": "left ventricle", "pvn": "pulmonary vein", "ao": "aorta",
            "sart": "artery",
        }.items()
    ),
    Row(
        65, FULL.replace('"pre_oxy"', '"lv"'), {"access_site": '"svn"'}, "W",
        ("systemic embolism", "venous blood, which bypasses lungs"),
    ),
    Row(65, FULL.replace('"pre_oxy"', '"ra"'), {}, "OK"),
    Row(
        65, FULL.replace('"pre_oxy"', '"pre_rc"'), {}, "W",
        ("crrt.return_site", "behind the oxygenator of an ECMO that returns to the arteries"),
    ),
    Row(66, FULL, {"speed_rpm": "0"}, "W", ("ecmo.speed_rpm = 0", "flows back")),
    Row(68, FULL, {"pump": "0"}, "E", ("a name is needed", "Rotaflow, DP3")),
    Row(68, FULL, {"pump": '"rotaflow"'}, "E", ("did you mean Rotaflow?",)),
    Row(68, FULL, {"pump": '"HVAD"'}, "E", ("Rotaflow, DP3",)),
    Row(69, FULL, {"return_fr": "18"}, "W", ("interpolated", "15, 17, 19, 21, 23")),
    Row(69, FULL, {"drainage_fr": "27"}, "W", ("interpolated", "19, 21, 23, 25, 29")),
    Row(69, FULL, {"return_fr": "27"}, "E", ("15, 17, 19, 21, 23",)),
    Row(69, FULL, {"drainage_fr": '"7 mm"'}, "E", ("7 mm = 21 Fr",)),
    Row(69, FULL, {"drainage_fr": "7"}, "E", ("7 mm = 21 Fr", "19, 21, 23, 25, 29")),
    Row(69, FULL, {"return_fr": '"17Fr"'}, "OK"),
    Row(71, FULL, {"oxygenator": '"Quadrox-i Small Adult"', "PF": "6.5"}, "W", ("0.5 to 5 L/min",)),
    Row(
        71,
        PATIENT + ECMO,
        {"oxygenator": '"Quadrox-i Small Adult"', "pump": "{ roller_l_min = 6.5 }", "speed_rpm": ""},
        "W",
        ("ecmo.pump = 6.5", "0.5 to 5 L/min"),
    ),
    Row(74, FULL, add(LVAD), "OK", ("may oppose",)),
    Row(74, PATIENT + LVAD + LVAD, {}, "E", ("TOML",)),
    Row(74, PATIENT + (LVAD + LVAD).replace("[lvad]", "[[lvad]]"), {}, "E", ("2 times", "one [lvad]")),
    Row(74, PATIENT + LVAD.replace("[lvad]", "[[lvad]]"), {}, "E", ("element of a list", "single brackets")),
    Row(74, PATIENT + LVAD, {"inlet_site": '"ao"', "outlet_site": '"lv"'}, "W", ("against the heart",)),
    Row(17, FULL, {"SP": '"1.11e2"'}, "E", ("text in quotes", "did you mean 1.11e2?")),
    Row(17, FULL, {"SP": "9" * 5000}, "E", ("thousands of digits",)),
    Row(34, FULL, {"id": '""'}, "E", ("patient.id", "empty")),
    Row(34, FULL, {"id": '"   "'}, "E", ("empty",)),
    Row(34, FULL, {"id": '"' + "x" * 10000 + '"'}, "E", ("too long: 10000",)),
    Row(33, FULL, {"id": "7"}, "E", ('did you mean "7"?',)),
    Row(33, FULL, {"id": '"007"'}, "OK"),
    Row(100, FULL, {"id": '"Erika Mustermann"'}, "W", ("pseudonym", "(hidden)")),
    Row(100, FULL, {"id": '"1950-03-12"'}, "W", ("birth date",)),
    Row(100, FULL, {"id": '"4711008815"'}, "W", ("record number",)),
]  # fmt: skip


def name_of(row: Row) -> str:
    change = " ".join(f"{key}={value}"[:40] for key, value in row.change.items())
    return re.sub(r"\s+", " ", f"{row.number} {row.verdict} {change}")


@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_gets_its_verdict(row, tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(row.text(), encoding="utf-8")
    if row.verdict == "E":
        with pytest.raises(CaseError) as caught:
            read_case(file)
        message = str(caught.value)
        assert all(line.startswith(str(file)) for line in message.splitlines())
    else:
        reading = read_case(file)
        assert bool(reading.warnings) == (row.verdict == "W")
        message = "\n".join(map(str, (*reading.warnings, *reading.notes)))
    for text in row.says:
        assert text in message


@pytest.mark.parametrize(
    "change",
    [
        {"drainage_site": '"la"'},
        {"return_fr": '17\nsecond_return_site = "svn"\nsecond_return_fr = 15'},
        add('[vent]\nsite = "lv"\nfr = 12'),
    ],
    ids=["left atrium drained", "V-AV", "vent"],
)
def test_nothing_is_said_of_the_organs_flow_where_only_a_part_of_the_pumps_flow_adds_to_the_output(
    change, tmp_path
):
    file = tmp_path / "case.toml"
    file.write_text(Row(27, FULL, change, "OK").text(), encoding="utf-8")
    reading = read_case(file)
    assert not [text for text in map(str, (*reading.warnings, *reading.notes)) if "measurements.CO" in text]


def test_all_mistakes_of_a_file_are_told_at_once_with_their_lines(tmp_path):
    file = tmp_path / "case.toml"
    text = Row(
        0, FULL, {"age_years": "-3", "SP": "76", "DP": "83", "pump": '"DP4"', "CO": "3400"}, "E"
    ).text()
    file.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        read_case(file)
    lines = text.splitlines()
    result = {mistake.key: mistake.line for mistake in caught.value.mistakes}
    assert set(result) == {"patient.age_years", "measurements.SP", "measurements.CO", "ecmo.pump"}
    for key, line in result.items():
        assert lines[line - 1].startswith(key.partition(".")[2])


def test_crrt_lines_at_one_place_are_a_doubt_since_the_published_code_ran_it(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(FULL.replace('"post_oxy"', '"pre_pump"').replace('"pre_oxy"', '"pre_pump"'))
    (warning,) = read_case(file).warnings
    assert warning.key == "crrt.return_site"
    assert "recirculation" in warning.message
