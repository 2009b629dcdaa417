"""The list of outputs: every output of every kind of case is in it, with what the case needs for it."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import pytest

from eclsim.cases import read_mapping
from eclsim.cases.resolve import circuit_of
from eclsim.devices.registry import devices
from eclsim.outputs.registry import all_outputs
from eclsim.outputs.signals import output_names
from eclsim.reporting.output_catalogue import describe, output_catalogue

DOCS = Path(__file__).parents[2] / "docs"
PERSON = {
    "id": "P01", "sex": "male", "age_years": 60, "heart_rate_bpm": 90, "height_cm": 178, "weight_kg": 80,
}  # fmt: skip
ECMO = {
    "pump": "Rotaflow", "speed_rpm": 3425, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
    "drainage_cannula": "venous", "drainage_fr": 23, "return_site": "ao", "return_cannula": "arterial",
    "return_fr": 17,
}  # fmt: skip
CRRT = {"flow_ml_min": 200, "access_site": "ra", "return_site": "ra"}
REGIONS = "[physiology] regional = true"
GIVEN = {
    "[gas]": {"gas": {}},
    "[solutes]": {"solutes": {}, "fluid": {}},
    "[dialysed_drug]": {"dialysed_drug": {}},
    REGIONS: {"physiology": {"regional": True}},
    "[physiology] bronchial_fraction": {"physiology": {"bronchial_fraction": 0.02}},
    "[physiology] collapsible_veins = true": {"physiology": {"collapsible_veins": True}},
    "[physiology] pericardium = true": {"physiology": {"pericardium": True}},
    "[regulation] baroreflex or chemoreflex, [drugs] or [fluid]": {"drugs": {"noradrenaline": 0.1}},
    "[regulation] baroreflex or chemoreflex": {"regulation": {"baroreflex": 1.0}},
    "[regulation] hypoxic_vasodilation or carbon_dioxide_response": {
        "regulation": {"hypoxic_vasodilation": 1.0}
    },
    "[regulation] hypoxic_vasoconstriction": {"regulation": {"hypoxic_vasoconstriction": 1.0}},
    "[ecmo]": {"ecmo": ECMO},
    "[ecmo] second_drainage_site": {
        "ecmo": ECMO | {"second_drainage_site": "svn", "second_drainage_fr": 19}
    },
    "[ecmo] second_return_site": {"ecmo": ECMO | {"second_return_site": "svn", "second_return_fr": 15}},
    "[crrt]": {"crrt": CRRT},
    "[crrt] dialysate_ml_h or another flow of fluid": {"crrt": CRRT | {"net_ultrafiltration_ml_h": 100}},
    "[lvad]": {"lvad": {"pump": "HM3", "speed_rpm": 5000, "inlet_site": "lv", "outlet_site": "ao"}},
    "[renox]": {"renox": {"dialysate_ml_h": 1000}},
    "[vent]": {"vent": {"site": "la", "fr": 15}},
    "[septostomy]": {"septostomy": {"diameter_mm": 8}},
    "[iabp]": {"iabp": {"volume_ml": 40}},
    "no [physiology] regional": {},
}  # fmt: skip
OTHERS_NEED = {"[ecmo]": ("[vent]", "[renox]")}
CATALOGUE = output_catalogue()


def outputs_of(parts) -> tuple[str, ...]:
    sections = {}
    for part in parts:
        for name, content in GIVEN[part].items():
            sections[name] = sections.get(name, {}) | content
    if "vent" in sections or "renox" in sections:
        sections.setdefault("ecmo", ECMO)
    return output_names(circuit_of(read_mapping({"format": 1, "patient": PERSON, **sections}).case))


@pytest.mark.parametrize("needed", CATALOGUE)
def test_a_case_has_an_output_if_and_only_if_it_has_what_the_list_says(needed):
    parts = CATALOGUE[needed][0].needs
    names = {entry.key for entry in CATALOGUE[needed]}
    assert names <= set(outputs_of(parts))
    for part in parts:
        others = [other for other in parts if other != part]
        if part.startswith("no "):
            others.append(REGIONS)
        elif set(others) & set(OTHERS_NEED.get(part, ())):
            continue  # the case would be refused
        assert names.isdisjoint(outputs_of(others)), part


def test_every_output_is_in_the_list_once_and_has_words():
    entries = [entry for group in CATALOGUE.values() for entry in group]
    assert sorted(entry.key for entry in entries) == sorted(all_outputs())
    assert all(entry.label and entry.unit and entry.definition for entry in entries)


def test_an_output_of_a_named_device_has_its_section():
    assert describe("lvad.left.flow").needs == ("[lvad.left]",)
    assert describe("ecmo.femoral.SpreO2").needs == ("[ecmo.femoral]", "[gas]")
    assert describe("ecmo.femoral.SpreO2").place == "after drainage cannula femoral", (
        "of all cannulae and a vent"
    )


def test_keys_that_add_outputs_are_keys_of_their_section():
    for device in devices().values():
        assert {words.split()[0] for words in device.optional} <= set(device.section.fields())


# --- the page ---------------------------------------------------------------------------------------


def page_of_outputs() -> str:
    spec = importlib.util.spec_from_file_location("output_pages", DOCS / "_hooks" / "output_pages.py")
    assert spec is not None
    assert spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    page = SimpleNamespace(file=SimpleNamespace(src_uri="outputs.md"))
    return hook.on_page_markdown((DOCS / "outputs.md").read_text(encoding="utf-8"), page)


def test_every_output_of_every_case_is_on_the_page():
    page = page_of_outputs()
    for parts in ([], [REGIONS, "[gas]"], *(entries[0].needs for entries in CATALOGUE.values())):
        missing = [name for name in outputs_of(parts) if f"\n| `{name}`" not in page]
        assert missing == []


def test_the_tables_of_the_page_are_tables():
    rows = [line for line in page_of_outputs().splitlines() if line.startswith("| `")]
    assert len(rows) > 130
    assert {line.replace("\\|", "").count("|") for line in rows if not line.startswith("| first")} >= {6}
    assert "| `MAP` [(m)](#outputs) | mean arterial pressure | mmHg |" in page_of_outputs()
