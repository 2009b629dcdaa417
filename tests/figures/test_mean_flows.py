import pytest

from eclsim.simulation.figures import plot_mean_flows


def rows(ax) -> dict[str, float]:
    """Label and drawn value of each row."""
    labels = [label.get_text() for label in ax.get_yticklabels()]
    dots = [line for line in ax.get_lines() if line.get_marker() not in ("", "None", None)]
    return dict(zip(labels, (float(line.get_xdata()[0]) for line in dots), strict=True))


def test_flows_and_pressures_are_means_over_the_beat(ecmo_crrt):
    flows, pressures = plot_mean_flows(ecmo_crrt).axes
    assert flows.get_xlabel() == "Mean flow [L/min]"
    assert pressures.get_xlabel() == "Mean pressure [mmHg]"
    assert rows(flows)["oxygenator"] == pytest.approx(3.9, abs=0.01)
    assert rows(flows)["CRRT pump"] == pytest.approx(0.2, abs=1e-3)
    assert rows(pressures)["aorta"] == pytest.approx(70.3655, abs=0.05)
    assert rows(pressures)["before pump"] == pytest.approx(-58.8, abs=0.1)


def test_rows_are_those_of_the_circuit(healthy, ecmo, lvad):
    assert len(rows(plot_mean_flows(healthy).axes[0])) == 10
    assert len(rows(plot_mean_flows(ecmo).axes[0])) == 17
    assert len(rows(plot_mean_flows(ecmo).axes[1])) == 16
    assert list(rows(plot_mean_flows(lvad).axes[0]))[-1] == "LVAD pump"


def test_compartments_of_a_users_own_are_shown_under_their_names(healthy):
    own = healthy.assign(Pgraft=healthy["Pao"], Qgraft=healthy["Qao"], Vgraft=healthy["Vao"])
    flows, pressures = plot_mean_flows(own).axes
    assert "graft" in rows(flows)
    assert "graft" in rows(pressures)


def test_pressures_are_those_of_compartments(healthy):
    """The head over a connection, such as the arch vessels of a patient with regions, is no place."""
    regional = healthy.assign(Parchupper=healthy["Pao"] - healthy["Psart"], Qarchupper=healthy["Qao"])
    flows, pressures = plot_mean_flows(regional).axes
    assert "arch vessels" in rows(flows)
    assert rows(pressures) == rows(plot_mean_flows(healthy).axes[1])


def test_numbers_beyond_a_limit_have_its_mark(ecmo_crrt):
    high = ecmo_crrt.copy()
    high["pump_inlet_pressure"] = ((), -58.8, {"finding": "alarm"})
    figure = plot_mean_flows(high)
    assert any(t.get_text() == "−58.8 ▲" for t in figure.axes[1].texts)
    assert "▲ beyond a limit: alarm" in figure.get_supxlabel()


def test_numbers_and_names_do_not_overlap(ecmo_crrt):
    figure = plot_mean_flows(ecmo_crrt)
    figure.draw_without_rendering()
    boxes = [
        t.get_window_extent()
        for ax in figure.axes
        for t in (*ax.texts, *ax.get_yticklabels())
        if t.get_text()
    ]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[i + 1 :])


@pytest.mark.slow
def test_numbers_stay_within_the_axes(healthy, ecmo, ecmo_crrt, lvad):
    for case in (healthy, ecmo, ecmo_crrt, lvad):
        figure = plot_mean_flows(case)
        figure.draw_without_rendering()
        for ax in figure.axes:
            numbers = [t for t in ax.texts if any(map(str.isdigit, t.get_text()))]
            assert numbers
            assert max(t.get_window_extent().x1 for t in numbers) <= ax.get_window_extent().x1
