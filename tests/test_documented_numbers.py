"""Numbers printed in the documentation are those that the code gives today, to the last digit printed."""

import re
import shlex
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.devices.registry import find_parameter
from eclsim.validation.reference_cases import DATA, PAPER_PATIENT, demo_rows, reference_model

REPOSITORY = Path(__file__).parents[1]
EXAMPLES = REPOSITORY / "examples"
PAPER_CASE = DATA / "cases" / f"{PAPER_PATIENT}.toml"
pytestmark = pytest.mark.slow


def page(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


def table(name: str, *head: str) -> list[list[str]]:
    """Cells below the row of a page that begins with these cells."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page(name).splitlines()]
    (at,) = [k for k, row in enumerate(rows) if row[: len(head)] == list(head)]
    end = next((k for k in range(at, len(rows)) if len(rows[k]) == 1), len(rows))
    return rows[at + 2 : end]


def agrees(printed: str, value: float) -> bool:
    """Within what rounding to the last digit printed leaves, and a hundredth of that."""
    text = printed.replace("−", "-")
    decimals = len(text.partition(".")[2])
    return abs(value - float(text)) <= 0.51 * 10.0**-decimals


def differing(printed: Mapping[str, str], beat) -> list[str]:
    """What stands on a page beside what the beat has, by output; empty if all agree."""
    return [
        f"{name}: {text} printed, {float(beat[name]):.5g} now"
        for name, text in printed.items()
        if not agrees(text, float(beat[name]))
    ]


def beat_of(case: str, *settings: str):
    return eclsim.simulate(eclsim.read_case(EXAMPLES / f"{case}.toml", list(settings)).case)


def test_a_digit_that_is_another_is_seen():
    assert agrees("−1.2", -1.2499)
    assert not agrees("0.89", 0.8845)


COUNTED = {
    "V-A:": "V-A ECMO, 1 to 5 L/min",
    "22, matched": "V-A ECMO, animals matched",
    "LVAD:": "LVAD ramps against patients",
    "8, matched": "LVAD ramps, patient matched",
    "oxygenator:": "`gas`",
    "part of the": "`gas`",
    "gases:": "`gas`",
    "apnoea": "apnoea",
    "filter:": "`dialysis`",
    "in patients:": "`dialysis`",
    "pressures:": "CRRT pressures",
    "drugs:": "`drugs`",
    "fluid:": "`fluid`",
    "bleeding:": "healthy people who lose blood",
    "on noradrenaline:": "plasma that leaves on noradrenaline",
    "carbon dioxide:": "carbon dioxide, ventilated patients",
}
"""Words before a count on the page on credibility, and the row of the validation page that it is of."""


def test_the_credibility_page_counts_as_the_validation_page_does():
    """The verdicts of those tables are of `eclsim validate`. The filter's count was once an older one."""
    text, known = page("docs/credibility.md"), page("docs/validation.md")
    counts = set(re.findall(r"\b\d+ of \d+\b", text))
    assert counts <= set(re.findall(r"\b\d+ of \d+\b", known))
    for words, comparison in COUNTED.items():
        (row,) = re.findall(rf"^\| {re.escape(comparison)}.*\d of \d.*$", known, re.MULTILINE)
        counts = set(re.findall(rf"{re.escape(words)} (\d+ of \d+)", text))
        assert counts, words
        assert counts <= set(re.findall(r"\b\d+ of \d+\b", row)), words


def test_the_demonstration_of_the_readme():
    shown = re.findall(r"^(\w+) +([\d.]+) +([\d.]+)  (?:L/min|mmHg) ", page("README.md"), re.MULTILINE)
    got = {
        (row.name, f"{row.expected:.4g}"): row.got
        for row in demo_rows(eclsim.simulate(reference_model(PAPER_PATIENT)))
    }
    assert len(shown) >= 5
    assert [line for line in shown if not agrees(line[2], got[line[0], line[1]])] == []


def test_the_bounds_of_the_page_on_identification_are_those_of_a_fit():
    """The oxygenator's transfer began at 0.036 there, after its constant had become 0.0518."""
    rows = table("docs/identification.md", "key", "start", "bounds")
    assert len(rows) >= 6
    for key, start, printed in rows:
        bounds = find_parameter(key.strip("`")).bounds
        low, high = (float(one) for one in re.match(r"([\d.]+) to ([\d.]+)", printed).groups())
        assert (bounds.lower, bounds.upper) == pytest.approx((low, high)), key
        if re.fullmatch(r"[\d.]+", start):
            assert bounds.start == pytest.approx(float(start)), key


def test_the_answer_of_the_page_on_settings():
    from typer.testing import CliRunner

    from eclsim.cli.application import app

    text = page("docs/settings.md")
    (command,) = re.findall(r"^eclsim (settings demo-output/.*)$", text, re.MULTILINE)
    (shown,) = re.findall(r"^```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    arguments = [str(PAPER_CASE) if word.startswith("demo-output") else word for word in shlex.split(command)]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    answer, _, tables = shown.partition("\n\n")
    printed = " ".join((done.stdout + done.stderr).split())
    for part in (answer, *tables.splitlines()):
        assert " ".join(part.split()) in printed, part


def test_the_carbon_dioxide_that_the_page_on_settings_says_is_kept():
    text = page("docs/settings.md")
    (shown,) = re.findall(r"^    ```text\n    goal +value.*\n((?:    .*\n)+?)    ```$", text, re.MULTILINE)
    found = eclsim.reach(EXAMPLES / "veno_venous_gas.toml", "SaO2 > 92")
    printed = [line.removesuffix("yes").split() for line in shown.strip().splitlines()]
    results = (*found.goals, *found.kept)
    assert [" ".join(row[:2]) for row in printed[:1]] == ["SaO2 >"]
    for row, result in zip(printed, results, strict=True):
        value = row[row.index("default)") + 1] if "default)" in row else row[3]
        assert agrees(value, result.value), row
    rpm, sweep, before = re.search(
        r"PaCO2 \((\d+)\s+rpm, ([\d.]+) L/min of sweep\), below the ([\d.]+) mmHg", text
    ).groups()
    assert agrees(rpm, found.values[0])
    assert agrees(sweep, found.values[1])
    assert agrees(before, float(beat_of("veno_venous_gas")["PaCO2"]))


def test_the_patient_on_veno_venous_ecmo():
    names = (
        "SaO2", "PaO2", "PaCO2", "SpreO2", "PpostO2", "VO2_oxygenator", "VCO2_oxygenator",
        "recirculation_fraction",
    )  # fmt: skip
    rows = table("docs/gas-exchange.md", "", "SaO2 %", "PaO2 mmHg")
    for row, case in zip(rows, ("veno_venous_gas", "veno_venous_low_sweep"), strict=True):
        assert differing(dict(zip(names, row[1:], strict=True)), beat_of(case)) == []


def test_differential_hypoxaemia():
    names = ("CO", "native_share_upper", "SaO2", "SaO2_lower")
    for contractility, *cells in table("docs/regional-patient.md", "`Emaxlv`", "native output [L/min]"):
        beat = beat_of("differential_hypoxaemia", f"Emaxlv={contractility}")
        assert differing(dict(zip(names, cells, strict=True)), beat) == []
    sites = {"inferior cava": "ivc", "right atrium": "ra", "superior cava": "svc"}
    names = ("SaO2", "SaO2_lower", "SpreO2", "SvO2")
    for shunt, drained, *cells in table("docs/regional-patient.md", "shunt", "drained"):
        share = float(shunt.removesuffix(" %")) / 100.0
        beat = beat_of(
            "differential_hypoxaemia",
            f"Emaxlv={0.9 if share < 1.0 else 0.5}",
            f"gas.shunt_fraction={share}",
            f"ecmo.drainage_site={sites[drained]}",
        )
        assert differing(dict(zip(names, cells, strict=True)), beat) == []


def test_clearances_of_the_dialysis_example():
    rows = {row[0]: row[1:] for row in table("docs/dialysis.md", "lines", "effective clearance of urea")}
    for lines, access, back in (
        ("both in svn, both in ra", "svn", "svn"),
        ("b, c, g, h, i", "post_oxy", "pre_oxy"),
    ):
        beat = beat_of("dialysis", f"crrt.access_site={access}", f"crrt.return_site={back}")
        urea, creatinine, recirculated, _ = (cell.removesuffix(" mL/min") for cell in rows[lines])
        printed = {"effective_clearance_urea": urea, "effective_clearance_creatinine": creatinine}
        assert differing(printed, beat) == []
        share = float(beat["crrt_recirculated_fraction"]) * 100.0
        assert agrees(recirculated.removesuffix(" %"), share)


def test_the_antibiotic_of_the_example():
    from eclsim.course.drug import drug_in_words

    result = eclsim.course(Path("examples/antibiotic.toml"), minutes=1440.0)
    page = " ".join(Path("docs/dialysis.md").read_text(encoding="utf-8").split())
    assert drug_in_words(result) in page
    cleared, plasma = (result[name].interp(time_min=[470, 490, 479, 1440]).to_numpy() for name in
                       ("effective_clearance_drug", "drug_concentration"))  # fmt: skip
    words = f"clears {cleared[0]:.0f} mL/min, and the drug is down to {plasma[2]:.0f} mg/L"
    assert words in page
    assert f"clears {cleared[1]:.0f}." in page
    assert f"leaves {plasma[3]:.0f} instead of {plasma[2]:.0f} mg/L" in page


def test_the_sweep_that_fails_in_the_example():
    """One beat stands for the next ones while nothing but gases changes; the page says how closely."""
    sentence = r"sweep_failure.toml`, SaO2 (\d+) to (\d+) % in 12 minutes\) .* within (\S+) % and (\S+) mmHg"
    ((first, last, points, mmhg),) = re.findall(sentence, " ".join(page("docs/course.md").split()))
    first, last, points, mmhg = map(float, (first, last, points, mmhg))
    example, outputs = EXAMPLES / "sweep_failure.toml", ("SaO2", "PaO2", "PaCO2")
    quick = eclsim.course(example, minutes=14.0, every_min=1.0, outputs=outputs)
    every = eclsim.course_beats(example, minutes=14.0, outputs=outputs).interp(time_min=np.arange(15.0))
    quick = quick.interp(time_min=np.arange(15.0))
    assert (round(float(quick["SaO2"][2])), round(float(quick["SaO2"][14]))) == (first, last)
    for name, most in zip(outputs, (points, mmhg, mmhg), strict=True):
        apart = np.abs(quick[name].to_numpy() - every[name].to_numpy())[
            :14
        ]  # beats end just before the last minute
        assert 0.3 * most < apart.max() <= most


def test_renox_beside_crrt():
    rows = {row[0]: row[1:] for row in table("docs/dialysis.md", "", "RenOx", "CRRT, scheme g")}
    case: dict[str, Any] = eclsim.read_case(PAPER_CASE).case.as_mapping()
    case["blood_volume_policy"] = "patient_held"
    fluids = {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100}
    crrt = eclsim.simulate(read_mapping(case | {"crrt": case["crrt"] | fluids}).case)
    case.pop("crrt")
    renox = eclsim.simulate(read_mapping(case | {"renox": fluids}).case)
    pressure = [cell.removesuffix(" mmHg") for cell in rows["pressure that the effluent is held at"]]
    assert differing({"renox_effluent_pressure": pressure[0]}, renox) == []
    assert differing({"effluent_pressure": pressure[1]}, crrt) == []
    clearance = [cell.removesuffix(" mL/min") for cell in rows["clearance of urea"]]
    assert differing({"renox_clearance_urea": clearance[0]}, renox) == []
    assert differing({"clearance_urea": clearance[1]}, crrt) == []
    open_effluent = rows["ultrafiltration with an open effluent"][0].removesuffix(" L/h")
    assert agrees(open_effluent, float(renox["renox_free_ultrafiltration_ml_h"]) / 1000.0)


def numbers(name: str, sentence: str) -> list[str]:
    """The numbers of a sentence of a page, for each of which the pattern has `#`."""
    pattern = sentence.replace("#", r"(−?\d+(?:\.\d+)?)")
    ((*found,),) = [match.groups() for match in re.finditer(pattern, " ".join(page(name).split()))]
    return found


def test_recirculation_between_two_sites_grows_with_the_flow():
    """A share of 3 to 5 % was said of `mode = "VV"`, which is that of low flows only."""
    sentence = r"it is # % at # L/min \(# rpm\), # % at # \(# rpm\) and # % at # \(# rpm\)"
    printed = numbers("docs/gas-exchange.md", sentence)
    case: dict[str, Any] = eclsim.read_case(EXAMPLES / "veno_venous_gas.toml").case.as_mapping()
    ecmo = {**case["ecmo"], "drainage_site": "svn", "return_site": "ra"}
    del ecmo["drainage_mixing"]
    for share, flow, rpm in zip(printed[::3], printed[1::3], printed[2::3], strict=True):
        raw = case | {"ecmo": ecmo | {"speed_rpm": float(rpm)}}
        stiff, soft = (
            eclsim.simulate(read_mapping(raw | {"physiology": {"collapsible_veins": soft}}).case)
            for soft in (False, True)
        )
        assert agrees(flow, float(stiff["PF"]))
        assert agrees(share, 100.0 * float(stiff["recirculation_fraction"]))
        assert 0.009 < float(soft["recirculation_fraction"] - stiff["recirculation_fraction"]) < 0.02


def test_the_second_cannulae_of_the_page_on_case_files_suit_its_first_ones():
    """Its second return had the site that the page's first cannula drains, which is refused."""
    text = page("docs/case-files.md")
    (first,) = re.findall(r"^\[ecmo\]\n(.*?)\n\n", text, re.MULTILINE | re.DOTALL)[:1]
    (second,) = re.findall(r"^(second_return_site.*?)^```$", text, re.MULTILINE | re.DOTALL)
    patient = {"id": "second", "sex": "male", "age_years": 60, "heart_rate_bpm": 90}
    ecmo = tomllib.loads(f"{first}\n{second}")
    beat = eclsim.simulate(read_mapping({"format": 1, "patient": patient, "ecmo": ecmo}).case)
    assert min(float(beat[f"{which}_{line}_flow"]) for which in ("first", "second")
               for line in ("return", "drainage")) > 0.0  # fmt: skip


def test_the_carbon_dioxide_that_fluids_bring():
    case: dict[str, Any] = eclsim.read_case(EXAMPLES / "fluid_removal.toml").case.as_mapping()
    for key in ("fluid", "solutes", "events"):
        del case[key]
    brought, with_it, without, more, at_24 = numbers(
        "docs/dialysis.md",
        r"bring # mL/min of carbon dioxide, and PaCO2 is # mmHg instead of the # without them\. .* they "
        r"bring # mL/min, and PaCO2 is # mmHg",
    )
    for added, gas, pressure in (({}, brought, with_it), ({"plasma_bicarbonate_mmol_l": 24}, more, at_24)):
        beat = eclsim.simulate(read_mapping(case | {"crrt": case["crrt"] | added}).case)
        assert differing({"crrt_carbon_dioxide_removal": f"−{gas}", "PaCO2": pressure}, beat) == []
    lines = {key: case["crrt"][key] for key in ("flow_ml_min", "access_site", "return_site")}
    assert differing({"PaCO2": without}, eclsim.simulate(read_mapping(case | {"crrt": lines}).case)) == []


def man(age: float, rate: float, drugs: Mapping[str, float], **parameters: float):
    """Steady beat of a man without devices; with parameters, of 178 cm and 80 kg."""
    patient = {"id": "man", "sex": "male", "age_years": age, "heart_rate_bpm": rate}
    patient |= {"height_cm": 178, "weight_kg": 80} if parameters else {}
    raw = {"format": 1, "patient": patient, "parameters": parameters, "drugs": dict(drugs)}
    return eclsim.simulate(read_mapping(raw).case)


def test_the_men_of_the_page_on_drugs():
    before, after, output, lower = numbers(
        "docs/drugs.md", r"from # to # mmHg and his output from # to # L/min"
    )
    assert differing({"MAP": before, "CO": output}, man(60, 75, {})) == []
    assert differing({"MAP": after, "CO": lower}, man(60, 75, {"milrinone": 0.5})) == []
    held, rest = numbers("docs/drugs.md", r"no reflex\) has # mmHg on 25 ug/min and # with this rest")
    _, raised, tight, tighter = numbers(
        "docs/drugs.md", r"rises from # to # mmHg on 0.03 U/min, and with `Rmc` 0.5 from # to # mmHg"
    )
    for noradrenaline, vasopressin, resistance, printed in (
        (25.0, 0.0, 0.33, held), (5.3, 0.02, 0.33, rest), (25.0, 0.03, 0.33, raised),
        (25.0, 0.0, 0.5, tight), (25.0, 0.03, 0.5, tighter),
    ):  # fmt: skip
        drugs = {"noradrenaline": noradrenaline / 80.0, "vasopressin": vasopressin}
        assert differing({"MAP": printed}, man(60, 90, drugs, Emaxlv=1.0, Rmc=resistance)) == []


def test_the_output_that_rises_with_the_rate():
    for printed, rate in zip(
        numbers("docs/limits.md", r"L/min in place of #, # and #\. With a duration"),
        (110, 150, 180),
        strict=True,
    ):
        assert differing({"CO": printed}, man(40, rate, {})) == []


def test_a_litre_of_blood_that_the_published_patient_loses():
    from eclsim.validation.regulation import EXTRA_VOLUME, REFLEXES, adult

    blood = numbers("docs/regulation.md", r"published constants, #, # and # mL come from the veins")
    falls = numbers("docs/regulation.md", r"output falls by #, # and # %")
    rises = numbers("docs/regulation.md", r"heart rate rises by #, # and # %")
    for reflex, released, fall, rise in zip(REFLEXES, blood, falls, rises, strict=True):
        patient = adult(75.0, regulation={"baroreflex": 1.0, "model": reflex})
        before, after = (eclsim.simulate(patient.with_values({EXTRA_VOLUME: ml})) for ml in (0.0, -1000.0))
        assert differing({"unstressed_volume": f"−{released}"}, after) == []
        change = {name: 100.0 * float(after[name] / before[name] - 1.0) for name in ("CO", "heart_rate")}
        assert differing({"CO": f"−{fall}", "heart_rate": rise}, change) == [], reflex


def test_the_day_of_fluid_removal():
    settings = {
        "`LpS` 10": ["fluid.filtration_ml_min_mmHg=10"],
        "`LpS` 1": [],
        "`LpS` 10, `pericapillary_share` 0.12": [
            "fluid.filtration_ml_min_mmHg=10", "fluid.pericapillary_share=0.12",
        ],
        "no refill": ["fluid.capillary_refill=false"],
    }  # fmt: skip
    names = ("blood", "MAP", "CO", "lowest_drainage_pressure", "haematocrit", "fluid.refilled_ml")
    start, *walls = table("docs/fluid.md", "at 24 h, 2.4 L removed", "blood volume")
    ends = {}
    for wall, *cells in walls:
        day = eclsim.course(eclsim.read_case(EXAMPLES / "fluid_removal.toml", settings[wall]).case)
        day["blood"] = day["fluid.plasma_ml"] + day["fluid.red_cells_ml"]
        for row, moment in ((start[1:], 0), (cells, -1)):
            shown = {name: cell.split()[0] for name, cell in zip(names, row, strict=True) if cell}
            assert differing(shown, day.isel(time_min=moment)) == [], wall
        ends[wall] = day
    urea, bicarbonate, faster = numbers(
        "docs/fluid.md",
        r"Urea falls from 35 to # mmol/L, and bicarbonate rises from 18 to # \(`LpS` 1; # with 10",
    )
    assert differing({"urea": urea, "bicarbonate": bicarbonate}, ends["`LpS` 1"].isel(time_min=-1)) == []
    assert differing({"bicarbonate": faster}, ends["`LpS` 10"].isel(time_min=-1)) == []
    for printed, minutes in zip(numbers("docs/fluid.md", r"PaCO2 falls from # to # mmHg in the first hour"),
                                (0.0, 60.0), strict=True):  # fmt: skip
        assert agrees(printed, float(ends["`LpS` 1"]["PaCO2"].interp(time_min=minutes)))


def test_fluid_removed_without_a_reflex():
    heldt = {"regulation": {"baroreflex": 1.0, "model": "heldt2010"}}
    woman = {"id": "woman", "sex": "female", "age_years": 50, "height_cm": 168, "weight_kg": 70,
             "heart_rate_bpm": 100}  # fmt: skip
    ecmo = {"mode": "VV", "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult"}
    crrt = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy",
            "net_ultrafiltration_ml_h": 50}  # fmt: skip
    first, last, with_reflex = numbers("docs/fluid.md", r"falls from # to # mmHg, with `heldt2010` to #\.")
    for reflex, end in (({}, last), (heldt, with_reflex)):
        raw = {"format": 1, "patient": woman, "ecmo": ecmo, "crrt": crrt} | reflex
        day = eclsim.course(read_mapping(raw).case, minutes=1440.0, outputs=["MAP"])
        assert differing({"MAP": first}, day.isel(time_min=0)) == []
        assert differing({"MAP": end}, day.isel(time_min=-1)) == []
