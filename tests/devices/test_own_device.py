"""A device in a file of a user's own goes all the way of the devices of the package."""

import json
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import xarray as xr

from eclsim.app.course import case_at_minute, with_event
from eclsim.app.display import display
from eclsim.app.drawing import drawing_of
from eclsim.app.files import export
from eclsim.app.knobs import connect, connectable, controls, turn, value_of
from eclsim.app.state import PageState
from eclsim.cases import CaseError, apply_settings, read_case, read_mapping
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
from eclsim.cases.sections import MEASURED
from eclsim.cli import main
from eclsim.devices import Device, Section, Views, check_sites, highest, registry
from eclsim.devices.device import Naming
from eclsim.devices.registry import DeviceError, devices, forget_device, load_device_file, register_device
from eclsim.identification.predictions import predict
from eclsim.identification.quantities import predicted_outputs, unit_of
from eclsim.inputs.mistakes import Remarks
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.parameters.parameter import Parameter
from eclsim.reporting.schematic import draw_circuit
from eclsim.sensitivity.inputs import InputError, varied_inputs
from eclsim.simulation.figures import available_parts, plot_mean_flows, plot_waveforms
from eclsim.simulation.panels import panels_of
from eclsim.simulation.summary import show, sweep_text
from eclsim.simulation.sweep import Sweep

EXAMPLES = Path(__file__).parents[2] / "examples"
FILE, CASE = EXAMPLES / "percutaneous_rvad.py", EXAMPLES / "percutaneous_rvad.toml"


@pytest.fixture(autouse=True)
def forgotten(monkeypatch):
    """What a test registers is gone after it."""
    before = set(devices())
    monkeypatch.setenv(registry.FILES, "")
    yield
    for key in set(devices()) - before:
        forget_device(key)


@pytest.fixture
def rvad():
    (device,) = load_device_file(str(FILE))
    return device


@pytest.fixture(scope="module")
def beats():
    """Beats of the example with one and with two devices, each solved once."""
    load_device_file(str(FILE))
    single = read_case(CASE).case
    two = single.as_mapping()
    section = two["rvad"]
    two["rvad"] = {"a": section | {"speed_rpm": 1000.0}, "b": section | {"speed_rpm": 1200.0}}
    two = read_mapping(two).case
    simulated = {name: (case, simulate(model_of(case))) for name, case in (("alone", single), ("two", two))}
    forget_device("rvad")
    return simulated


def test_without_it_the_section_is_unknown():
    with pytest.raises(CaseError, match=r"rvad.*unknown key or section"):
        read_case(CASE)


def test_its_mistakes_are_those_of_a_section(rvad, tmp_path):
    text = CASE.read_text().replace("cannula_fr = 23", "cannula_fr = 7").replace('"part"', '"prt"')
    file = tmp_path / "case.toml"
    file.write_text(text)
    with pytest.raises(CaseError) as caught:
        read_case(file)
    first, second = map(str, caught.value.mistakes)
    assert "rvad.outlet_site" in first
    assert "did you mean part?" in first
    assert "rvad.cannula_fr = 7" in second
    assert "7 mm = 21 Fr" in second
    assert "no [rvad] section" in str(read_mapping(_with_parameter("Crvadin", 0.2)).warnings[0])


def _with_parameter(key, value):
    return PRESETS["healthy"].case().as_mapping() | {"parameters": {key: value}}


def test_a_case_with_it_is_written_and_read_back(rvad):
    case = read_case(CASE).case
    assert case.instance("rvad").section.speed_rpm == 1500
    assert "speed_rpm = 1500 # Pump speed [rpm]" in case_text(case)
    assert apply_settings(case, ["rvad.speed_rpm=2000"]).setting("rvad", "speed_rpm") == 2000


@pytest.mark.slow
def test_its_flow_joins_the_right_ventricles_and_its_outputs_are_there(rvad, beats):
    _, beat = beats["alone"]
    assert beat.attrs["converged"]
    flow = float(beat["rvad_flow"])
    assert flow == pytest.approx(2.65, abs=0.05)
    assert flow + float(beat["pulmonary_valve_flow"]) == pytest.approx(
        float(beat["pulmonary_flow"]), abs=1e-4
    )
    assert beat["rvad_head"].attrs["units"] == "mmHg"
    assert any("before the RVAD return" in sentence for sentence in beat.attrs["warnings"])


def test_two_of_a_kind_have_names_of_their_own(rvad, beats):
    case, beat = beats["two"]
    assert [one.key for one in case.instances()] == ["rvad.a", "rvad.b"]
    assert 0.5 < float(beat["rvad.a.flow"]) < float(beat["rvad.b.flow"])
    assert "Prvad.a.rvadin" in beat
    assert "RVAD flow, a" in beat["rvad.a.flow"].attrs["long_name"]
    changed = apply_settings(case, ["rvad.a.Crvadin=0.2"])
    values = model_of(changed).values
    assert (values["rvad.a.Crvadin"], values["rvad.b.Crvadin"]) == (0.2, 0.1)


def test_its_limits_raise_alarms(rvad):
    case = apply_settings(read_case(CASE).case, ["rvad.speed_rpm=3500"])
    warnings = simulate(model_of(case)).attrs["warnings"]
    assert any(
        "lowest pressure before the RVAD pump" in w and "suction: lower the speed" in w for w in warnings
    )


def test_it_is_drawn(rvad, beats):
    for name, boxes in (("alone", ["rvadin", "rvadout"]), ("two", ["rvad.a.rvadin", "rvad.b.rvadout"])):
        case, beat = beats[name]
        figure = draw_circuit(model_of(case).circuit, beat)
        gids = {str(patch.get_gid()) for patch in figure.axes[0].patches}
        assert {f"node-{box}" for box in boxes} <= gids
        words = {text.get_text() for text in figure.axes[0].texts}
        title = "RVAD circuit" if name == "alone" else "RVAD circuit a"
        assert {"drainage cannula", "return cannula", "Before RVAD pump", title} <= words


def test_figures_and_the_table_of_results_have_it(rvad, beats, capsys):
    for name, key, flow in (("alone", "rvad", "mean RVAD flow"), ("two", "rvad.b", "mean RVAD flow, b")):
        _, beat = beats[name]
        assert key in available_parts(beat)
        figure = plot_waveforms(beat, key)
        assert [ax.get_title(loc="left") for ax in figure.axes] == ["Pressures", "Flows", "Pump head"]
        assert "RVAD" in figure.get_suptitle()
        rows = [label.get_text() for label in plot_mean_flows(beat).axes[0].get_yticklabels()]
        assert any(row.startswith("RVAD pump") for row in rows)
        show([beat])
        assert flow in capsys.readouterr().out


def test_the_page_has_its_knobs_views_and_drawing(rvad):
    case = read_case(CASE).case
    keys = [control.key for control in controls(case)]
    assert {"rvad.speed_rpm", "rvad.pump", "rvad.inlet_site"} <= set(keys)
    assert turn(case, "rvad.speed_rpm", "1800").setting("rvad", "speed_rpm") == 1800
    assert value_of(case, "rvad.cannula_fr") == 23
    assert "Qrvadpump" in [trace["signal"] for trace in display(case)["traces"]]
    assert {"rvadin", "rvadout"} <= {box["name"] for box in drawing_of(case)["boxes"]}
    assert "rvad" in connectable()
    connected = connect(PRESETS["healthy"].case(), "rvad")
    assert connected.instance("rvad") is not None
    assert connect(connected, "rvad").instances() == ()


def test_an_export_names_the_file_that_the_case_needs(rvad):
    """The command of its course, pasted, failed: the section was unknown."""
    case = read_case(CASE).case
    plain = export(PageState(case), "case")[1].decode()
    assert f"eclsim --device {FILE.name} simulate" in plain.partition("\nformat")[0]
    later = with_event(case, {"at_min": 30, "set": {"rvad.speed_rpm": 1500}})
    told = export(PageState(later), "case")[1].decode()
    assert f"eclsim --device {FILE.name} course " in told
    assert str(FILE.parent) not in told
    assert "--device" not in export(PageState(PRESETS["healthy"].case()), "case")[1].decode()


def test_the_drawing_of_a_later_minute_has_its_inlet_at_the_site_of_that_minute(rvad):
    case = with_event(read_case(CASE).case, {"at_min": 30, "set": {"rvad.inlet_site": "rv"}})
    drawings = [drawing_of(case_at_minute(case, minute)) for minute in (0.0, 40.0)]
    sites = [{line["ends"][0] for line in drawing["lines"]} for drawing in drawings]
    assert "ra" in sites[0]
    assert "rv" in sites[1]


@pytest.mark.slow
def test_predictions_have_its_outputs(rvad):
    """They were only those that can be measured."""
    model = model_of(read_case(CASE).case)
    names = predicted_outputs(model.circuit)
    assert {"MAP", "CO", "rvad_flow", "rvad_head", "rvad_inlet_pressure"} <= set(names)
    draws = {"rvad.speed_rpm": np.array([1400.0, 1500.0, 1600.0])}
    prediction = predict(model, draws, names)
    low, median, high = prediction.intervals[names.index("rvad_flow")]
    assert median == pytest.approx(2.65, abs=0.05)
    assert low < median < high
    assert [unit_of(name) for name in ("MAP", "rvad_flow", "rvad_head")] == ["mmHg", "L/min", "mmHg"]
    assert predicted_outputs(model_of(PRESETS["healthy"].case()).circuit)[-1] in MEASURED


def test_its_settings_are_inputs_of_a_sensitivity_analysis(rvad):
    case = read_case(CASE).case
    values = model_of(case).values
    design = varied_inputs(case, values, parameters=("Rmc",), include=("rvad.speed_rpm", "Crvadin"))
    assert [one.name for one in design.inputs] == ["Rmc", "rvad.speed_rpm", "Crvadin"]
    with pytest.raises(
        InputError,
        match=r"rvad\.speed_rpm: the perturbation reaches .* 1000 to 5000; .* --range rvad\.speed_rpm=1000:",
    ):
        varied_inputs(case, values, parameters=(), include=("rvad.speed_rpm",), perturbation_percent=50.0)


def test_the_command_line_takes_its_file(capsys):
    with pytest.raises(SystemExit) as left:
        main(["--device", str(FILE), "devices", "rvad"])
    assert not left.value.code
    shown = capsys.readouterr().out
    assert "[rvad]: RVAD" in shown
    assert "Crvadin" in shown


@pytest.mark.slow
def test_a_command_simulates_a_case_with_it(capsys):
    with pytest.raises(SystemExit) as left:
        main(["--device", str(FILE), "simulate", str(CASE), "--json", "-"])
    assert not left.value.code
    (case,) = json.loads(capsys.readouterr().out)["cases"]
    assert case["more_outputs"]["rvad_flow"] == pytest.approx(2.65, abs=0.05)
    assert case["waveforms"]["Prvadin"]["mean"] < 0


def test_a_file_that_registers_nothing_or_fails_is_refused(tmp_path, capsys):
    for text, why in (("x = 1\n", "registers no device"), ("1 / 0\n", "ZeroDivisionError")):
        file = tmp_path / "own.py"
        file.write_text(text)
        with pytest.raises(DeviceError, match=why):
            load_device_file(str(file))
    with pytest.raises(DeviceError, match="not a Python file"):
        load_device_file(str(tmp_path / "missing.py"))
    with pytest.raises(SystemExit) as left:
        main(["--device", str(tmp_path / "missing.py"), "devices"])
    assert left.value.code == 2
    assert "not a Python file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "instead", "why"),
    [
        ('Limit("rvad_inlet_pressure"', 'Limit("rvad_inlet_presure"', "did you mean rvad_inlet_pressure"),
        ('"alarm", "below"', '"alarm", "belw"', "'alarm', 'belw'; allowed: collapse, alarm, warning; below"),
        ('mean("rvad_head"', 'mean("rvad_flow"', "output 'rvad_flow': the name of another output"),
        ('mean("rvad_head"', 'mean("PF"', "output 'PF': the name of another output"),
        ('mean("rvad_head"', 'mean("MAP"', "output 'MAP': the name of an output of the patient"),
        ('"Prvadpump")', '"Prvadpmp")', "output 'rvad_head': 'Prvadpmp' is not a waveform"),
        ('"Prvadpump")', '"Prvadpmp")', "did you mean Prvadpump"),
        ('"Prvadin")', '"rvadin")', "output 'rvad_inlet_pressure': 'rvadin' is not a waveform"),
        ('Trace("Qrvadpump"', 'Trace("Qrvadpumpe"', "trace 'RVAD flow': 'Qrvadpumpe' is not a waveform"),
    ],
)
def test_outputs_of_other_names_and_limits_of_none_are_refused(written, instead, why, tmp_path, capsys):
    # A misspelt limit raised no alarm, a misspelt waveform dropped its output; an output "MAP" stood in the
    # place of the patient's.
    file = tmp_path / "own.py"
    assert written in FILE.read_text()
    file.write_text(FILE.read_text().replace(written, instead, 1))
    with pytest.raises(SystemExit) as left:
        main(["--device", str(file), "devices"])
    assert left.value.code == 2
    assert why in " ".join(capsys.readouterr().err.split())


def test_a_case_file_cannot_name_code(tmp_path):
    text = CASE.read_text().replace("format = 1", f'format = 1\ndevice = "{FILE}"')
    file = tmp_path / "case.toml"
    file.write_text(text)
    with pytest.raises(CaseError, match=r"device = .*unknown key or section"):
        read_case(file)
    assert "eclsim_device_percutaneous_rvad" not in sys.modules or "rvad" not in devices()


class Shunt(Section):
    section = "shunt"
    resistance: Annotated[float, "no field"]


@pytest.mark.parametrize(
    ("key", "section", "why"),
    [
        ("lvad", Shunt, "none of"),
        ("patient", Shunt, "none of"),
        ("A b", Shunt, "lower-case letters"),
        ("shunt", object, "must be a subclass of"),
        ("other", Shunt, "its name in a case file"),
        ("shunt", Shunt, "annotated with its Field"),
    ],
)
def test_a_device_that_no_case_file_could_hold_is_refused(key, section, why):
    own = type(
        "Own", (Device,), {"key": key, "name": "Own", "section": section, "circuit": None, "values": None}
    )
    own.__abstractmethods__ = frozenset()
    with pytest.raises(DeviceError, match=why):
        register_device(own)


def test_a_device_may_read_waveforms_of_the_patient_and_of_other_devices():
    """Also those of a patient in regions or with veins that collapse."""
    names = ("Psvc", "Qlv", "Vlv", "Pao", "Pecmodrain", "Qecmopump", "Ptvc")
    outputs = tuple(highest(f"own_{name.lower()}", name, name) for name in names)
    try:
        assert register_device(_own(outputs=outputs)).outputs == outputs
    finally:
        forget_device("own")


def test_an_installed_package_offers_devices(monkeypatch):
    sys.path.insert(0, str(EXAMPLES))
    try:
        entry = EntryPoint("rvad", "percutaneous_rvad:RvadDevice", registry.ENTRY_POINTS)
        broken = EntryPoint("none", "no_such_module:Device", registry.ENTRY_POINTS)
        monkeypatch.setattr(registry, "entry_points", lambda group: [broken, entry])
        monkeypatch.setattr(registry, "_LOADED", set())
        with pytest.warns(UserWarning, match=r"device none .* is left out"):
            assert "rvad" in devices()
        assert devices()["rvad"].name == "RVAD"
    finally:
        sys.path.remove(str(EXAMPLES))
        sys.modules.pop("percutaneous_rvad", None)


def test_a_device_has_parameters_of_its_own_names():
    """Its Rmc would silently become the patient's."""
    parameter = (Parameter("Rmc", 0.05, "mmHg s/mL", "x", "here", 0.01, 1.0, "own"),)
    with pytest.raises(DeviceError, match="'Rmc': the name of a parameter of the patient"):
        register_device(_own(parameters=parameter))


def test_two_devices_of_ones_own_do_not_share_a_parameter(rvad):
    parameter = (Parameter("Crvadin", 0.05, "mL/mmHg", "x", "here", 0.01, 1.0, "own"),)
    with pytest.raises(DeviceError, match="'Crvadin': the name of a parameter of the patient or of another"):
        register_device(_own(parameters=parameter))


def _own(**names):
    """A device that is refused for one reason alone."""
    section = type("Own", (Section,), {"section": "own", "__annotations__": {}})
    described = {"key": "own", "name": "Own", "section": section, "circuit": None, "values": None} | names
    own = type("Own", (Device,), described)
    own.__abstractmethods__ = frozenset()
    return own


def test_crrt_is_connected_at_its_positions(rvad):
    offers = type("Offers", (type(rvad),), {"positions": {"before_rvad_pump": "rvadin"}})
    register_device(offers)
    crrt = {"flow_ml_min": 150, "access_site": "before_rvad_pump", "return_site": "svn"}
    case = read_mapping(read_case(CASE).case.as_mapping() | {"crrt": crrt}).case
    beat = simulate(model_of(case))
    assert float(beat["crrt_flow"]) == pytest.approx(0.15, rel=1e-3)
    assert "before_rvad_pump" in case.as_mapping()["crrt"]["access_site"]
    without = {key: value for key, value in case.as_mapping().items() if key != "rvad"}
    with pytest.raises(CaseError, match=r"the case has no \[rvad\] section"):
        read_mapping(without)


def test_work_that_is_resumed_knows_the_file_of_a_device(tmp_path):
    """An edited device file gives other results: those of the file before are not gone on with."""
    from eclsim.execution import Distribution, ExecutionError
    from eclsim.sensitivity.analysis import SobolSettings, plan_analysis

    def opened(text: str) -> None:
        file = tmp_path / "percutaneous_rvad.py"
        file.write_text(text)
        load_device_file(str(file))
        try:
            settings = SobolSettings(samples=2, parameters=("Rmc",), outputs=("CO",))
            store = plan_analysis(read_case(CASE).case, settings).folder(tmp_path / "kept")
            with Distribution(resume=True).running() as executor:
                store.open(executor)
        finally:
            forget_device("rvad")

    opened(FILE.read_text())
    opened(FILE.read_text())
    with pytest.raises(ExecutionError, match=r"\(model\.device_files\.rvad\); choose another"):
        opened(FILE.read_text() + "\n# another law\n")


LONG = "percutaneous right ventricular assist device for a failing right heart"


def test_a_long_name_leaves_the_instance_readable(rvad):
    """The end of a name was cut, so that two of a kind had the same title."""
    one, two = Naming(type("Long", (type(rvad),), {"name": LONG})(), "left_leg"), Naming(rvad, "left" * 9)
    assert one.cut(one.label, 40) == "percutaneous right ventricular… left_leg"
    assert one.cut("short left_leg", 40) == "short left_leg"
    assert len(two.cut(two.label, 28)) <= 28
    assert Naming(one.device).cut(LONG, 20) == "percutaneous right…"


@pytest.mark.filterwarnings("error")
def test_figures_of_a_long_name_have_room(beats, rvad):
    """The axes collapsed to nothing, and a warning of the layout was printed."""
    long = type("Long", (type(rvad),), {"name": LONG})
    register_device(long)
    _, beat = beats["two"]
    beat = beat.rename({name: name.replace("rvad.a.", "rvad.right_leg_with_a_long_name.") for name in beat})
    for figure in (plot_mean_flows(beat), plot_waveforms(beat, "rvad.right_leg_with_a_long_name")):
        figure.canvas.draw()
        assert min(ax.get_window_extent().width for ax in figure.axes) > 100.0
    shown = [text.get_text() for ax in figure.axes for text in ax.get_legend().get_texts()]
    assert "before RVAD pump" in shown
    assert not any("long_name" in text for text in shown)


def test_its_flow_is_in_the_table_of_a_sweep_and_of_a_course(beats, rvad, capsys):
    """It was in neither, even when its own key was varied."""
    _, beat = beats["alone"]
    sweep = Sweep("P", "rvad.speed_rpm", "rpm", (1500.0,), 1500.0, (beat,))
    assert " rvad_flow " in sweep_text(sweep).splitlines()[1]
    with pytest.raises(SystemExit):
        main(["--device", str(FILE), "course", str(CASE), "--until", "0.1"])
    assert "rvad_flow [L/min]" in capsys.readouterr().out


def test_its_flow_is_in_the_figure_of_a_sweep_without_a_curve(rvad):
    register_device(type("Plain", (type(rvad),), {"views": Views()}))
    table = xr.Dataset(dict.fromkeys(("CO", "rvad_flow", "rvad_head"), 1.0))
    (flows,) = [panel for panel in panels_of(table) if panel.unit == "L/min"]
    assert "rvad_flow" in flows.names
    assert "rvad_head" not in flows.names


def test_a_shunt_that_is_meant_is_not_doubted():
    sites = {"inlet_site": "ao", "outlet_site": "ra"}
    doubted, meant = Remarks(), Remarks()
    check_sites("avs", sites, "inlet_site", "outlet_site", doubted)
    check_sites("avs", sites, "inlet_site", "outlet_site", meant, shunt=True)
    assert "arterio-venous shunt" in str(doubted.warnings[0])
    assert meant.warnings == []
    check_sites("avs", sites | {"outlet_site": "ao"}, "inlet_site", "outlet_site", meant, shunt=True)
    assert meant.mistakes
