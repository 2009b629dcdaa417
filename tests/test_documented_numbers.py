"""Numbers printed in the documentation are those that the code gives today, to the last digit printed."""

import re
import shlex
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


def test_the_credibility_page_counts_as_the_validation_page_does():
    """Each count there is one of the tables of rows; the verdicts of those are of `eclsim validate`."""
    counts, known = (
        re.findall(r"\b\d+ of \d+\b", page(f"docs/{name}.md")) for name in ("credibility", "validation")
    )
    assert len(counts) > 20
    assert set(counts) <= set(known)


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
