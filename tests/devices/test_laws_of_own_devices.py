"""A law from outside the package that the solver cannot use is refused before a beat, with its place."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import jax.numpy as jnp
import pytest

from eclsim.cases import read_mapping
from eclsim.circuit import Circuit, Compartment, Connection, Exchange
from eclsim.circuit.own_laws import mistakes_of_own_laws
from eclsim.cli import main
from eclsim.components import ElasticVessel, GasExchanger, Resistance, RotaryPump, Storage
from eclsim.components import Path as BloodPath
from eclsim.components.base import Key, value_of
from eclsim.course.timeline import Timeline
from eclsim.devices import Device, Parameter, Section, number, patient_site
from eclsim.devices.registry import DeviceError, forget_device, register_device
from eclsim.orbit.model import Model
from eclsim.orbit.status import Status
from eclsim.outputs.results import simulate
from model_catalogue import model


@dataclass(frozen=True)
class Law(BloodPath):
    resistance: Key = 1.0
    above_zero: ClassVar = ("resistance",)

    def pressure_drop(self, flow, constants):
        return value_of(constants, self.resistance) * flow


def law(drop, **more) -> type[Law]:
    """A law with another drop, or another attribute."""
    return dataclass(frozen=True)(type("Own", (Law,), {"pressure_drop": drop} | more))


def faults(path, values=None) -> str:
    circuit = Circuit(connections=(Connection("line", path, "ao", "ra"),))
    return "\n".join(mistakes_of_own_laws(circuit, values or {}))


FALLING = law(lambda self, q, c: 0.1 * q + 0.001 * q * abs(q) - 40.0 * jnp.tanh(q / 5.0))
ROOT = law(lambda self, q, c: jnp.sign(q) * jnp.sqrt(jnp.abs(q)))
BRANCHED = law(lambda self, q, c: q if q > 0.0 else 2.0 * q)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (FALLING, r"line.*Own\): its pressure drop falls by 76\.2 mmHg between -0\.808 and 0\.808 L/min"),
        (law(lambda self, q, c: 1e-3 * q**2 - 300.0), "between -10 and 0 L/min.*write Q |Q| in place of"),
        (law(lambda self, q, c: 0.02 * (q - 20.0) ** 2 * jnp.sign(q - 20.0) - q), "falls by .* L/min"),
        (law(lambda self, q, c: -q), "falls at all flows: is its sign reversed"),
        (law(lambda self, q, c: jnp.sqrt(-1.0 - q**2)), "not finite between -10 and 10 L/min"),
        (law(lambda self, q, c: 1.0 / q), "not finite at 0 L/min"),
        (ROOT, "slope of its pressure drop is not finite at 0 L/min"),
        (BRANCHED, r"TracerBoolConversionError \(.*, line \d+\): a law is compiled: write jnp.where"),
        (law(lambda self, q, c: float(q)), r"line \d+\): a law is compiled"),
        (law(lambda self, q, c: jnp.stack([q, q])), "must return one number"),
        (law(lambda self, q, c: c["R.mine"] * q), "reads 'R.mine', which no field annotated as Key names"),
    ],
)  # fmt: skip
def test_a_law_that_cannot_be_solved_is_named(own, said):
    assert [line for line in faults(own()).splitlines() if re.search(said, line)], faults(own())


@pytest.mark.parametrize(
    "own",
    [
        Law(),
        RotaryPump("speed", "pump."),  # of the package, without values
        law(lambda self, q, c: 1e-3 * jnp.sinh(1e3 * q))(),  # infinite far from 0
        law(lambda self, q, c: 5.0)(),  # an open clamp with a constant head
        law(lambda self, q, c: jnp.maximum(q, 0.0) + 0.01 * jnp.minimum(q, 0.0))(),
        law(lambda self, q, c: jnp.nan * q, given_flow=True)(),
        law(lambda self, q, c: jnp.sqrt(q + 1e-3), one_way=True, flow=lambda self, dp, load, c: dp)(),
    ],
)
def test_a_law_that_rises_passes(own):
    assert faults(own) == ""


def test_values_that_are_refused_elsewhere_are_left_to_it():
    assert faults(Law("R"), {"R": 0.0}) == ""
    assert faults(Law("R"), {}) == ""
    assert faults(Law("R"), {"R": -1.0}) == ""


def test_a_model_is_refused_at_the_values_of_the_case():
    """A law that rises at the usual values may fall at those of a case."""
    own = law(lambda self, q, c: q - value_of(c, self.resistance) * jnp.tanh(q))
    published = model("none")
    added = Connection("line", own("fistula"), "ao", "ra")
    circuit = replace(published.circuit, connections=(*published.circuit.connections, added))
    assert Model(circuit, {**published.values, "fistula": 0.5})
    with pytest.raises(DeviceError, match=r"connection 'line' \(Own\): its pressure drop falls"):
        Model(circuit, {**published.values, "fistula": 5.0})


@dataclass(frozen=True)
class Membrane(GasExchanger):
    permeance: float

    def rates(self, flow, inside, values):
        return self.permeance * inside.pressure


@pytest.mark.parametrize(
    ("permeance", "said"),
    [(1.0, ""), (float("nan"), "`rates` is not finite at a PO2 of 40 and a PCO2 of 46")],
)
def test_rates_of_an_exchanger_are_finite(permeance, said):
    blood = dict.fromkeys(Membrane(1.0).parameter_names(), 10.0)
    circuit = Circuit(exchanges=(Exchange("membrane", Membrane(permeance), "line"),))
    (*found,) = mistakes_of_own_laws(circuit, blood)
    assert said in "".join(found)
    assert bool(found) == bool(said)


def test_numbers_that_are_not_finite_may_come_from_a_law():
    """Only parameters were blamed."""
    assert "a law of your own gives no finite number" in Status.NOT_FINITE.message


def store(pressure) -> Circuit:
    own = dataclass(frozen=True)(type("Own", (Storage,), {"pressure": pressure}))
    return Circuit((Compartment("sac", own()),))


@pytest.mark.parametrize(
    ("pressure", "said"),
    [
        (lambda self, v, a, c: (v, 1.0), ""),
        (lambda self, v, a, c: (jnp.log(v), 1.0 / v), ""),  # not finite at 0 alone
        (lambda self, v, a, c: (jnp.sqrt(-1.0 - v), 1.0), "its pressure is finite at no volume"),
        (lambda self, v, a, c: (v, jnp.where(a > 0.9, jnp.inf, 1.0)), "its stiffness is finite at no volume"),
        (lambda self, v, a, c: v, r"`pressure` must return two numbers, pressure \[mmHg\] and stiffness"),
        (lambda self, v, a, c: (v, 1.0, 0.0), "`pressure` must return two numbers"),
        (lambda self, v, a, c: (jnp.stack([v, v]), 1.0), "`pressure` must return two numbers"),
        (lambda self, v, a, c: None, "`pressure` must return two numbers"),
        (lambda self, v, a, c: (v, 1.0) if v > 0.0 else (0.0, 1.0), r"line \d+\): a law is compiled"),
    ],
)  # fmt: skip
def test_a_store_without_a_pressure_is_named(pressure, said):
    found = "\n".join(mistakes_of_own_laws(store(pressure), {}))
    assert re.search(f"compartment 'sac' \\(Own\\): .*{said}", found) if said else found == "", found


def test_the_pulsatile_element_of_the_documentation_works():
    """Squeezed in diastole beside the aorta, it raises diastolic pressure and moves no blood on average."""
    text = (Path(__file__).parents[2] / "docs/add-a-component.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n((?:(?!```).)*class SqueezedSac.*?)```", text, re.DOTALL)
    names = {"dataclass": dataclass, "ClassVar": ClassVar, "Key": Key, "value_of": value_of}
    exec(block, names)  # the documentation's own example
    published, beats = model("none"), []
    sac = Compartment("sac", names["SqueezedSac"]("Csac", "squeeze"), "own")
    line = Connection("sacline", Resistance(0.05), "ao", "sac", "own")
    for squeeze in (0.0, 60.0):
        values = {**published.values, "Csac": 0.3, "squeeze": squeeze}
        beats.append(simulate(Model(published.circuit + Circuit((sac,), (line,)), values)))
    still, driven = beats
    assert driven.attrs["converged"]
    assert abs(driven["Qsacline"].attrs["mean"]) < 1e-3 * driven["Qsacline"].attrs["maximum"]
    late = driven["phase"] > 0.5
    assert float(driven["Pao"][late].max()) > float(still["Pao"][late].max()) + 2.0


# --- at registration -------------------------------------------------------------------------------


@dataclass(frozen=True)
class TextForKey(Law):
    resistance: str = ""  # pyright: ignore[reportIncompatibleVariableOverride]  # the mistake


class Shunt(Section):
    section = "shunt"
    site: Annotated[str, patient_site("Artery")]
    opening: Annotated[float, number("Opening", "-", 0.01, 1, 1)] = 1.0


class ShuntDevice(Device[Shunt]):
    key, name, section = "shunt", "Shunt", Shunt
    compartments: ClassVar = {"shunt": "chamber"}
    connections: ClassVar = {"shuntin": "inlet", "shuntout": "outlet"}
    parameters = (
        Parameter("Cshunt", 1.0, "mL/mmHg", "C", "assumed", 0.1, 10.0, "shunt"),
        Parameter("shunt.linear", 1.0, "mmHg s/mL", "R", "assumed", 0.1, 10.0, "shunt"),
    )
    usual: ClassVar = {"site": "ao"}
    outlet = Law("shunt.linear")
    chamber = "shunt"
    inlet = ""

    def circuit(self, section):
        return Circuit(
            (Compartment("shunt", ElasticVessel("Cshunt")),),
            (
                Connection("shuntin", Resistance("shunt.opening"), self.inlet or section.site, "shunt"),
                Connection("shuntout", self.outlet, self.chamber, "ra"),
            ),
        )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"chamber": "shnt"}, r"ShuntDevice.circuit: connection 'shuntout': source 'shnt'.*mean shunt"),
        ({"outlet": Law("shunt.lineer")}, "'shunt.lineer', which connection 'shuntout'.*mean shunt.linear"),
        ({"outlet": TextForKey("shunt.linear")}, "annotation of `resistance` is not Key: write"),
        ({"outlet": FALLING()}, r"device shunt, connection 'shuntout' \(Own\): its pressure drop falls"),
        ({"usual": {"site": "femoral"}}, "usual: shunt.site = \"femoral\": unknown name"),
        ({"usual": {}, "chamber": "shnt"}, ""),
        ({"usual": {"opning": 1.0}}, "usual: shunt.opning.*did you mean opening"),
        ({"circuit": lambda self, section: section.opning}, r"AttributeError: .*opning.*line \d+"),
        ({"inlet": "pre_oxy"}, ""),  # a site of another device
        ({"inlet": "femoral"}, "'femoral' is not a compartment"),
        ({"usual": {"site": "svc"}}, ""),  # a site of the regional patient
    ],
)  # fmt: skip
def test_a_circuit_with_a_mistake_is_refused_when_it_is_registered(changes, said):
    made = type("ShuntDevice", (ShuntDevice,), {"__module__": __name__, **changes})
    try:
        if said:
            with pytest.raises(DeviceError, match=said):
                register_device(made)
        else:
            register_device(made)
    finally:
        forget_device("shunt")


def test_an_event_of_a_course_that_makes_a_law_fall_is_named():
    """The course went on with the beat that creates blood."""
    own = law(lambda self, q, c: q - jnp.where(value_of(c, self.resistance) < 0.5, 40.0, 0.0) * jnp.tanh(q))
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
    event = {"at_min": 1, "set": {"shunt.opening": 0.1}}
    raw = {"format": 1, "patient": patient, "shunt": {"site": "ao"}, "events": [event]}
    register_device(type("ShuntDevice", (ShuntDevice,), {"outlet": own("shunt.opening")}))
    try:
        with pytest.raises(DeviceError, match=r"events\[1\]: connection 'shuntout'.*its pressure drop falls"):
            assert Timeline(read_mapping(raw).case, 120.0).changes
    finally:
        forget_device("shunt")


def test_without_a_usual_section_the_command_says_it_in_one_line(tmp_path, capsys):
    """It was a traceback."""
    text = Path(__file__).read_text()
    own = text[
        text.index("class Shunt(Section)") : text.index(
            "@pytest.mark.parametrize", text.index("class Shunt(")
        )
    ]
    head = text[text.index("import jax.numpy") : text.index("def law(")].replace(
        "from model_catalogue import model\n", ""
    )
    head = "from dataclasses import dataclass\nfrom typing import Annotated, ClassVar\n" + head
    wrong = own.replace('{"site": "ao"}', "{}").replace('chamber = "shunt"', 'chamber = "shnt"')
    file, case = tmp_path / "shunt.py", tmp_path / "case.toml"
    file.write_text(f"{head}\n{wrong}\nregister_device(ShuntDevice)\n")
    case.write_text(
        'format = 1\n[patient]\nid = "P"\nsex = "male"\nage_years = 60\nheart_rate_bpm = 75\n'
        '[shunt]\nsite = "ao"\n'
    )
    try:
        with pytest.raises(SystemExit) as left:
            main(["--device", str(file), "simulate", str(case)])
    finally:
        forget_device("shunt")
    assert left.value.code == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert line.startswith(f"error: --device {file}: connection 'shuntout': source 'shnt'")
