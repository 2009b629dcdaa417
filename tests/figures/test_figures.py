import pytest

from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import ecmo
from eclsim.files import file_stem
from eclsim.patient.circulation import circulation
from eclsim.simulation.figures import write_case_figures


@pytest.mark.slow
def test_all_figures_of_a_case_are_written(tmp_path, ecmo_crrt):
    circuit = circulation() + ecmo("ra", "ao") + crrt("ecmotuor", "ecmooxy")
    hostile = ecmo_crrt.assign_attrs(id="<script>alert(1)</script>")
    files = write_case_figures(circuit, hostile, tmp_path / "figures", formats=["svg"])
    kinds = {"circuit", "overview", "pressure_volume", "mean_flows"}
    kinds |= {f"waveforms_{part}" for part in ("heart", "systemic", "pulmonary", "ecmo", "crrt")}
    stem = file_stem("<script>alert(1)</script>")
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
