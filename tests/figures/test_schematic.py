from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations, pairwise

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eclsim.circuit import Choice, Circuit, Compartment, Connection
from eclsim.components import ElasticVessel, Resistance
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import POSITIONS, Ecmo, ecmo
from eclsim.devices.lvad import lvad
from eclsim.devices.renox import RENOX, Renox
from eclsim.devices.septostomy import SEPTOSTOMY, Septostomy
from eclsim.devices.vent import SITES as VENTED
from eclsim.devices.vent import VENT, Vent
from eclsim.outputs.registry import all_outputs
from eclsim.patient.circulation import Anatomy, circulation
from eclsim.reporting.schematic import draw_circuit
from eclsim.reporting.style import save_figure

PATIENT = circulation()
REGIONS = circulation(Anatomy(regional=True, bronchial=True))


def second(line: str, site: str) -> tuple[Connection, ...]:
    """A second cannula of an ECMO circuit."""
    more = {f"second_{line}_site": site, f"second_{line}_fr": 17.0}
    section = Ecmo(pump="Rotaflow", speed_rpm=3000, oxygenator="Quadrox-i Adult", mode="VA", **more)  # type: ignore[arg-type]
    return section.second_connections()


VA_SECOND = PATIENT + ecmo("ra", "ao", second=second("return", "pas"))
SITES = tuple(compartment.name for compartment in PATIENT.compartments)
SCHEMES = {
    "a": ("post_pump", "pre_oxy"),
    "b": ("pre_oxy", "pre_pump"),
    "c": ("post_oxy", "pre_pump"),
    "d": ("post_oxy", "pre_rc"),
    "e": ("pre_oxy", "pre_rc"),
    "f": ("pre_oxy", "post_oxy"),
    "g": ("post_oxy", "pre_oxy"),
    "h": ("pre_pump", "post_dc"),
    "h as run": ("pre_pump", "pre_pump"),
    "i": ("post_pump", "pre_pump"),
}
VA = PATIENT + ecmo("ra", "ao")
VV = PATIENT + ecmo("svn", "ra")


def vent(site: str) -> Circuit:
    """A vent into the drainage line of an ECMO circuit."""
    drained = replace(VENT.circuit(Vent(site=site, fr=15.0)).connections[0], target=POSITIONS["post_dc"])  # type: ignore[arg-type]
    return Circuit(connections=(drained,))


CIRCUITS = {
    "none": PATIENT,
    "V-A": VA,
    "V-V": VV,
    **{f"V-A, CRRT {key}": VA + crrt(POSITIONS[a], POSITIONS[r]) for key, (a, r) in SCHEMES.items()},
    "V-V, CRRT b": VV + crrt(POSITIONS["pre_oxy"], POSITIONS["pre_pump"]),
    "LVAD": PATIENT + lvad(),
    "CRRT on svn, ra": PATIENT + crrt("svn", "ra"),
    "CRRT on sart, part": PATIENT + crrt("sart", "part"),
    "all": VA + crrt(POSITIONS["post_oxy"], POSITIONS["pre_oxy"]) + lvad(),
    "all on patient": VA + crrt("sart", "part") + lvad("la", "sart"),
    "all left": VV + crrt("svn", "ra") + lvad("pvn", "pas"),
    "all at sart": PATIENT + ecmo("sart", "sart") + crrt("sart", "sart") + lvad("part", "sart"),
    "two LVADs": PATIENT + lvad().prefixed("lvad.left") + lvad("ra", "pas").prefixed("lvad.right"),
    "two left LVADs": PATIENT + lvad().prefixed("lvad.a") + lvad("la", "ao").prefixed("lvad.b"),
    "two ECMO circuits": VA + ecmo("svn", "ra").prefixed("ecmo.second"),
    "regions": REGIONS + ecmo("ivc", "lower"),
    "regions, V-A": REGIONS + ecmo("ra", "ao") + crrt(POSITIONS["post_oxy"], POSITIONS["pre_oxy"]),
    "regions, LVAD": REGIONS + lvad(),
    "regions, V-A, LVAD": REGIONS + ecmo("ivc", "lower") + lvad(),
    "regions, two LVADs": REGIONS + lvad().prefixed("lvad.left") + lvad("rv", "part").prefixed("lvad.right"),
    "bronchial return": circulation(Anatomy(bronchial=True)),
    "bronchial return, all": circulation(Anatomy(bronchial=True)) + ecmo("ra", "ao") + lvad(),
    "V-AV": VA_SECOND,
    "regions, bicaval": REGIONS + ecmo("ivc", "lower", second=second("drainage", "svc")),
    "V-A, RenOx": VA + RENOX.circuit(Renox(dialysate_ml_h=2000.0)),
    **{f"V-A, vent of {site}": VA + vent(site) for site in VENTED},
    "V-A, vent, CRRT, LVAD": VA + vent("lv") + crrt("ecmotuor", "ecmooxy") + lvad(),
    "all at part": PATIENT + ecmo("part", "part") + crrt("part", "part") + lvad("sart", "part"),
}


def constant_result(circuit: Circuit, pressure: float = -234.5, flow: float = -198.7) -> xr.Dataset:
    """Numbers as long as they get, so that labels are as wide as they get."""
    phase = np.linspace(0.0, 1.0, 5)
    names = {f"P{part.name}": pressure for part in circuit.compartments}
    names |= {f"Q{part.name}": flow for part in circuit.connections}
    names |= {f"P{part.name}": pressure for part in circuit.connections if part.name.endswith("pump")}
    curves = {name: ("phase", np.full_like(phase, value)) for name, value in names.items()}
    scalars = {"SP": 188.0, "DP": 142.0, "MAP": 161.0, "MPAP": 34.5, "PCWP": 22.5, "CO": 12.34, "PF": 5.67}
    scalars["crrt_recirculated_fraction"] = 0.375
    scalars |= {"renox_effluent_ml_h": 9000.0, "renox_effluent_pressure": -234.5}
    coordinates = {"phase": phase, "time": ("phase", 0.5 * phase)}
    attributes = {"id": "P" * 60, "converged": 0, "blood_volume_policy": "patient_volume_held"}
    return xr.Dataset({**curves, **scalars}, coordinates, attributes)


@cache
def shown_texts(figure: Figure) -> list[tuple[Text, Bbox]]:
    texts = [text for ax in figure.axes for text in ax.texts if text.get_text()]
    renderer = FigureCanvasAgg(figure).get_renderer()  # one for all: each is as large as the picture
    return [(text, text.get_window_extent(renderer)) for text in texts]


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    return [
        (a.get_text(), b.get_text())
        for (a, first), (b, second) in combinations(shown_texts(figure), 2)
        if first.overlaps(second)
    ]


def line_pieces(figure: Figure) -> Iterator[Bbox]:
    """Every straight piece of every line, as wide as it is drawn."""
    for line in figure.axes[0].get_lines():
        half = 0.5 * line.get_linewidth() * figure.dpi / 72
        for (x0, y0), (x1, y1) in pairwise(line.get_transform().transform(line.get_xydata())):
            yield Bbox.from_extents(
                min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half
            )


def boxes(figure: Figure) -> dict[str, Bbox]:
    patches = figure.axes[0].patches
    return {
        str(patch.get_gid()).removeprefix("node-"): patch.get_window_extent()
        for patch in patches
        if str(patch.get_gid()).startswith("node-")
    }


def device_line(figure: Figure, name: str) -> Line2D:
    (line,) = [line for line in figure.axes[0].get_lines() if line.get_gid() == f"line-{name}"]
    return line


def ends_on(point: np.ndarray, box: Bbox, figure: Figure) -> bool:
    reach = 3.0 * figure.dpi / 25.4  # mm of arrow head
    return box.padded(reach).contains(*point)


@cache
def drawn(name: str) -> Figure:
    return draw_circuit(CIRCUITS[name], constant_result(CIRCUITS[name]))


@pytest.mark.parametrize("name", CIRCUITS)
def test_no_label_covers_another_or_leaves_the_page(name: str):
    assert overlapping_texts(drawn(name)) == []
    page = drawn(name).bbox
    assert [t.get_text() for t, box in shown_texts(drawn(name)) if box.x0 < page.x0 or box.x1 > page.x1] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", CIRCUITS)
def test_no_line_runs_through_a_label_or_a_box(name: str):
    texts, pieces = shown_texts(drawn(name)), list(line_pieces(drawn(name)))
    assert [text.get_text() for text, box in texts for piece in pieces if box.overlaps(piece)] == []
    inner = {key: box.padded(-2.0) for key, box in boxes(drawn(name)).items()}
    assert [key for key, box in inner.items() for piece in pieces if box.overlaps(piece)] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", CIRCUITS)
def test_labels_of_a_box_stay_inside_it(name: str):
    for box in boxes(drawn(name)).values():
        inside = [text for _, text in shown_texts(drawn(name)) if box.overlaps(text)]
        assert len(inside) == 3
        assert all(box.x0 < text.x0 and text.x1 < box.x1 for text in inside)


def test_a_dialyzer_in_the_housing_of_the_oxygenator_is_drawn_below_it_with_its_readings():
    figure = drawn("V-A, RenOx")
    housing = {str(p.get_gid()): p.get_window_extent() for p in figure.axes[0].patches}["housed-renox"]
    inside = {text.get_text() for text, box in shown_texts(figure) if housing.contains(*box.min)}
    assert inside == {"RenOx: effluent", "9000 mL/h, −234 mmHg"}
    before, after = (boxes(figure)[name] for name in ("ecmooxy", "ecmotuor"))
    start, *_, end = np.asarray(device_line(figure, "renox").get_xydata())
    assert before.x1 < figure.axes[0].transData.transform(start)[0] < after.x0, "at the oxygenator's symbol"
    assert ends_on(figure.axes[0].transData.transform(end), housing, figure)
    assert not any(housing.overlaps(box) for box in boxes(figure).values())


@pytest.mark.slow
def test_saturations_stand_in_their_boxes_with_a_scale():
    result = constant_result(CIRCUITS["regions, V-A"])
    for compartment in CIRCUITS["regions, V-A"].compartments:
        result[f"P{compartment.name}"].attrs["SO2"] = 100.0
    figure = draw_circuit(CIRCUITS["regions, V-A"], result)
    assert overlapping_texts(figure) == []
    for box in boxes(figure).values():
        inside = [(text.get_text(), at) for text, at in shown_texts(figure) if box.overlaps(at)]
        assert "100 %" in [words for words, _ in inside]
        assert all(box.x0 < at.x0 and at.x1 < box.x1 for _, at in inside)
    words = [text.get_text() for text, _ in shown_texts(figure)]
    assert {"oxygen saturation", "40 %", "75 %"} <= set(words)


@pytest.mark.parametrize("name", [name for name in CIRCUITS if name != "two ECMO circuits"])
def test_figure_fits_on_a4(name: str):
    width, height = drawn(name).get_size_inches() * 25.4
    assert width <= 190
    assert height <= 270


@pytest.mark.parametrize("drainage", SITES)
def test_ecmo_lines_end_at_the_sites_of_the_circuit(drainage: str):
    returned = SITES[(SITES.index(drainage) + 4) % len(SITES)]
    figure = draw_circuit(PATIENT + ecmo(drainage, returned))
    places = boxes(figure)
    for name, source, target in (
        ("ecmodrain", drainage, "ecmodrain"),
        ("ecmoreturn", "ecmoreturn", returned),
    ):
        line = device_line(figure, name)
        corners = line.get_transform().transform(line.get_xydata())
        assert ends_on(corners[0], places[source], figure)
        assert ends_on(corners[-1], places[target], figure)
    assert overlapping_texts(figure) == []


@pytest.mark.parametrize("name", [*POSITIONS, *SITES])
def test_crrt_lines_end_at_the_sites_of_the_circuit(name: str):
    site = POSITIONS.get(name, name)
    figure = draw_circuit(VA + crrt(site, "ra" if site != "ra" else "svn"))
    line = device_line(figure, "crrttuin")
    corners = line.get_transform().transform(line.get_xydata())
    places = boxes(figure)
    assert ends_on(corners[0], places[site], figure)
    assert ends_on(corners[-1], places["crrttuin"], figure)


@pytest.mark.parametrize(("inlet", "outlet"), [("lv", "ao"), ("la", "ao"), ("rv", "pas"), ("part", "sart")])
def test_lvad_lines_end_at_the_sites_of_the_circuit(inlet: str, outlet: str):
    figure = draw_circuit(PATIENT + lvad(inlet, outlet))
    into, out = (line for line in figure.axes[0].get_lines() if line.get_gid() == "line-lvadpump")
    places = boxes(figure)
    assert ends_on(into.get_transform().transform(into.get_xydata())[0], places[inlet], figure)
    assert ends_on(out.get_transform().transform(out.get_xydata())[-1], places[outlet], figure)


@pytest.mark.parametrize("site", VENTED)
def test_a_vent_is_a_line_of_its_own_colour_into_the_ecmo_circuit(site: str):
    figure = drawn(f"V-A, vent of {site}")
    line, of_ecmo = device_line(figure, "vent"), device_line(figure, "ecmodrain")
    ends = line.get_transform().transform(line.get_xydata())
    assert ends_on(ends[0], boxes(figure)[site], figure)
    assert ends_on(ends[-1], boxes(figure)[POSITIONS["post_dc"]], figure)
    assert line.get_color() == VENT.look.colour != of_ecmo.get_color()


def test_a_hole_in_the_septum_is_one_line_with_its_drop_of_pressure():
    """The line had a gap, as for a pump, and the drop was "rise −2 mmHg"."""
    circuit = VA + SEPTOSTOMY.circuit(Septostomy(diameter_mm=10.0))
    result = constant_result(circuit, pressure=-200.0)
    figure = draw_circuit(circuit, result.assign(Pseptostomy=result["Pra"]))
    assert {"septostomy", "drop 200 mmHg"} <= {text.get_text() for text, _ in shown_texts(figure)}
    line = device_line(figure, "septostomy")
    points = figure.axes[0].transData.transform(line.get_xydata())
    assert ends_on(points[0], boxes(figure)["la"], figure)
    assert ends_on(points[-1], boxes(figure)["ra"], figure)


def test_numbers_are_means_over_the_beat(ecmo_crrt: xr.Dataset):
    figure = draw_circuit(CIRCUITS["V-A, CRRT g"], ecmo_crrt)
    words = [text.get_text() for text in figure.axes[0].texts]
    assert {"70.4 mmHg", "119.4 mmHg", "−45.6 mmHg"} <= set(words)  # aorta, CRRT access line, after drainage
    assert words.count("200 mL/min") == 5
    assert words.count("3.70 L/min") == 6  # ECMO, but for the oxygenator, which CRRT recirculates through
    assert words.count("3.90 L/min") == 1


def test_recirculation_of_crrt_is_shown(ecmo_crrt: xr.Dataset):
    figure = draw_circuit(CIRCUITS["V-A, CRRT g"], ecmo_crrt.assign(crrt_recirculated_fraction=0.054))
    assert "CRRT recirculation 5 %" in [text.get_text() for text in figure.axes[0].texts]


def test_a_device_that_is_not_connected_is_not_drawn(healthy: xr.Dataset):
    words = " ".join(text.get_text() for text in draw_circuit(PATIENT, healthy).axes[0].texts)
    assert "Right atrium" in words
    assert not any(word in words for word in ("ECMO", "CRRT", "LVAD", "pump"))


def test_without_a_result_names_alone_are_drawn():
    words = [text.get_text() for text in draw_circuit(VA).axes[0].texts]
    assert "Right atrium" in words
    assert not any("mmHg" in word or "L/min" in word for word in words)


def with_findings(circuit: Circuit, kinds: dict[str, str]) -> xr.Dataset:
    """A result whose outputs have these findings, each to be read with care, too."""
    result = constant_result(circuit)
    for name, kind in kinds.items():
        result[name] = ((), 1.0, {"finding": kind, "read_with_care": 1})
    return result


def box_words(figure: Figure, place: str) -> set[str]:
    return {t.get_text() for t, at in shown_texts(figure) if boxes(figure)[place].contains(*at.min)}


def test_every_number_beyond_a_limit_has_the_mark_of_the_page():
    """Only the lines in the middle had marks: a pressure of CRRT far beyond its alarm stood there bare."""
    circuit = CIRCUITS["V-A, CRRT c"]
    kinds = {
        "crrt_access_pressure": "alarm", "right_atrial_pressure": "warning", "PF": "alarm",
        "ejection_fraction_lv": "caution", "EDVRV": "collapse", "pulse_pressure": "warning",
    }  # fmt: skip
    figure = draw_circuit(circuit, with_findings(circuit, kinds))
    assert "▲† −234.5 mmHg" in box_words(figure, "crrttuin")
    assert "!† −234.5 mmHg" in box_words(figure, "ra")
    assert "✕ −234.5 mmHg" in box_words(figure, "rv")
    assert "! −234.5 mmHg" in box_words(figure, "ao"), "of its pulse pressure"
    assert "−234.5 mmHg" in box_words(figure, "lv"), (
        "a caution on the ejection fraction is none on a pressure"
    )
    words = [text.get_text() for text, _ in shown_texts(figure)]
    assert "▲† −11.92 L/min" in words
    (legend,) = [line for line in words if "say why" in line]
    assert all(f"{mark} " in legend for mark in "✕▲!†")
    assert not any("say why" in text.get_text() for text, _ in shown_texts(drawn("V-A, CRRT c")))


@pytest.mark.parametrize("name", ["V-A, CRRT c", "regions, V-A", "V-A, RenOx"])
@pytest.mark.parametrize("gases", [False, True])
def test_marks_leave_room_for_numbers(name: str, gases: bool):
    circuit = CIRCUITS[name]
    result = with_findings(circuit, dict.fromkeys(all_outputs(), "alarm"))
    for compartment in circuit.compartments if gases else ():
        result[f"P{compartment.name}"].attrs["SO2"] = 100.0
    figure = draw_circuit(circuit, result)
    assert overlapping_texts(figure) == []
    for box in boxes(figure).values():
        inside = [text for _, text in shown_texts(figure) if box.overlaps(text)]
        assert all(box.x0 < text.x0 and text.x1 < box.x1 for text in inside)


@pytest.mark.slow
def test_compartments_of_a_users_own_stand_in_a_spare_row():
    own = tuple(Compartment(f"graft{i}", ElasticVessel(1.0), "own") for i in range(6))
    paths = (
        Connection("shunt", Resistance(1.0), "la", "ra", "own"),
        Connection("to_graft", Resistance(1.0), "ao", "graft0", "own"),
        *(Connection(f"join{i}", Resistance(1.0), f"graft{i}", f"graft{i + 1}", "own") for i in range(5)),
        Connection("from_graft", Resistance(1.0), "graft5", "svn", "own"),
    )
    circuit = CIRCUITS["all"] + Circuit(own, paths)
    figure = draw_circuit(circuit, constant_result(circuit))
    words = " ".join(text.get_text() for text in figure.axes[0].texts)
    assert all(part.name in words for part in (*own, *paths))
    assert overlapping_texts(figure) == []
    assert not any(a.overlaps(b) for a, b in combinations(boxes(figure).values(), 2))


def test_a_site_chosen_per_patient_is_named_and_not_drawn():
    sites = tuple(POSITIONS.values())
    figure = draw_circuit(VA + crrt(Choice(sites, "crrt.access"), "ecmooxy"))
    assert any("Not drawn" in t.get_text() and "crrttuin" in t.get_text() for t in figure.axes[0].texts)
    assert overlapping_texts(figure) == []


def test_a_chosen_site_is_drawn_as_if_it_were_fixed():
    sites = tuple(POSITIONS.values())
    choice = VA + crrt(Choice(sites, "crrt.access"), Choice(sites, "crrt.return"))
    values = {"crrt.access": 4.0, "crrt.return": 1.0}
    figures = draw_circuit(choice, values=values), draw_circuit(VA + crrt(sites[4], sites[1]))
    texts, lines = (
        [[read(artist) for artist in getattr(f.axes[0], kind)] for f in figures]
        for kind, read in (("texts", lambda t: t.get_text()), ("lines", lambda c: c.get_xydata().tolist()))
    )
    assert texts[0] == texts[1]
    assert lines[0] == lines[1]


def test_text_shrinks_with_the_axes_given():
    page = Figure(figsize=(6, 8))
    ax = page.add_subplot(2, 2, 1)
    assert draw_circuit(VA, constant_result(VA), ax=ax) is page
    page.draw_without_rendering()
    assert overlapping_texts(page) == []


def test_title_is_shown_as_text_and_escaped(tmp_path):
    figure = draw_circuit(PATIENT, title="<script>alert($x_1$)</script>")
    (svg, _) = save_figure(figure, tmp_path / "a")
    text = svg.read_text(encoding="utf-8")
    assert "&lt;script&gt;alert($x_1$)&lt;/script&gt;" in text
    assert "<script" not in text
