import re

import pytest

from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import ecmo
from eclsim.patient.circulation import circulation
from eclsim.simulation.figures import file_name, write_case_figures


def test_all_figures_of_a_case_are_written(tmp_path, ecmo_crrt):
    circuit = circulation() + ecmo("ra", "ao") + crrt("ecmotuor", "ecmooxy")
    hostile = ecmo_crrt.assign_attrs(id="<script>alert(1)</script>")
    files = write_case_figures(circuit, hostile, tmp_path / "figures", formats=["svg"])
    kinds = {"circuit", "overview", "pressure_volume", "mean_flows"}
    kinds |= {f"waveforms_{part}" for part in ("heart", "systemic", "pulmonary", "ecmo", "crrt")}
    stem = file_name("<script>alert(1)</script>")
    assert {path.name for path in files} == {f"{stem}_{kind}.svg" for kind in kinds}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {path.name for path in files}
    for path in files:
        text = path.read_text(encoding="utf-8")
        assert "<script" not in text
        assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text


@pytest.mark.slow
def test_figures_come_as_svg_and_png(tmp_path, healthy):
    one_curve = healthy[["Plv", "Prv", "Vlv", "Vrv", "Pla", "Pra", "Vla", "Vra"]]
    files = write_case_figures(circulation(), one_curve, tmp_path)
    assert {path.suffix for path in files} == {".svg", ".png"}
    assert {path.stem for path in files if path.suffix == ".svg"} == {
        path.stem for path in files if path.suffix == ".png"
    }


@pytest.mark.parametrize(
    "case_id", ["../../etc/x", "a/b", "", "..", "C:\\x", "NUL\0", "x" * 300, "患者", "\ud800"]
)
def test_file_names_are_safe(case_id: str):
    assert re.fullmatch(r"[A-Za-z0-9_-]{1,60}", file_name(case_id))


def test_file_names_of_different_ids_differ():
    ids = ["a b", "a/b", "a_b", "a  b", "A_B", "x" * 60, "x" * 61, "", "_"]
    assert len({file_name(case_id) for case_id in ids}) == len(ids)
    assert file_name("P01-b_2") == "P01-b_2"
