import csv
import io
import json
import tomllib

import pytest

from eclsim.cases import read_mapping
from eclsim.devices import ecmo, lvad
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.ecmo_parts import OXYGENATORS
from eclsim.devices.registry import parameters
from eclsim.parameters import physiology, shi_hose2009

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}


def test_listing_shows_every_parameter(shell):
    for command in (["parameters"], ["parameters", "list"]):
        shown = [line.split()[0] for line in shell.run(*command).stdout.splitlines()[1:]]
        assert shown == list(parameters())


def test_listing_can_be_narrowed(shell):
    shown = shell.run("parameters", "list", "--group", "crrt").stdout.splitlines()[1:]
    assert len(shown) == 17
    assert "Rcrrtfil" in "".join(shown)
    refused = shell.run("parameters", "list", "--group", "crt")
    assert refused.exit_code == 2
    assert "did you mean crrt?" in refused.stderr
    assert "Csas" in shell.run("parameters", "list", "--set", "shi_hose2009").stdout


def test_explaining_one(shell):
    text = shell.run("parameters", "explain", "rmc").stdout
    for words in (
        "Resistance of systemic microcirculation",
        "0.5 mmHg s/mL",
        "0.02 to 8",
        "Table S-1",
        "0.05 and 5",
    ):
        assert words in text
    refused = shell.run("parameters", "explain", "Rmcc")
    assert refused.exit_code == 2
    assert "did you mean Rmc" in refused.stderr


@pytest.mark.parametrize("name", ["thiel2025", "physiology", "shi_hose2009"])
def test_exports_agree(shell, name):
    as_csv = shell.run("parameters", "export", "--format", "csv", "--set", name).stdout
    as_json = shell.run("parameters", "export", "--format", "json", "--set", name).stdout
    as_toml = shell.run("parameters", "export", "--format", "toml", "--set", name).stdout
    values = {row["key"]: float(row["value"]) for row in csv.DictReader(io.StringIO(as_csv))}
    assert {row["key"]: row["value"] for row in json.loads(as_json)["parameters"]} == values
    sections = tomllib.loads(as_toml)
    settings = {f"physiology.{key}": value for key, value in sections.get("physiology", {}).items()}
    assert settings | sections["parameters"] == values
    published = {p.key: p for p in parameters().values() if "Thiel et al. 2025" in p.source}
    expected = {
        "thiel2025": published,
        "physiology": physiology.PARAMETERS,
        "shi_hose2009": shi_hose2009.PARAMETERS,
    }[name]
    assert values == {key: parameter.value for key, parameter in expected.items()}


def test_the_toml_export_is_a_section_of_a_case_file(shell):
    section = tomllib.loads(shell.run("parameters", "export", "--format", "toml").stdout)
    patient = {"id": "P01", "sex": "female", "age_years": 70, "heart_rate_bpm": 120}
    assert read_mapping({"format": 1, "patient": patient, **section}).case.parameters == section["parameters"]


def test_devices_are_listed_with_ranges_and_doubts(shell):
    text = shell.run("devices").stdout
    for name in (*PUMPS, *CANNULAE, *OXYGENATORS):
        assert name in text
    assert "4000 to 8000" in text
    assert "unvalidated" in text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("HeartMate 3", ("HM3", "17.001", "head at 3000 rpm: 33 at 0")),
        ("venous", ("19   38", "16")),
        ("quadrox-i adult", ("0.5 to 7 L/min", "335 mL")),
        ("Nautilus MC3", ("not known",)),
        ("Prismaflex filter", ("15.75",)),
    ],
)
def test_one_device(shell, name, words):
    text = shell.run("devices", name).stdout
    for word in words:
        assert word in text


def test_a_misspelt_device(shell):
    refused = shell.run("devices", "Rotaflo")
    assert refused.exit_code == 2
    assert "did you mean Rotaflow?" in refused.stderr
