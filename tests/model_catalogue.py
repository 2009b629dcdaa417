"""Models of every configuration, at the values of the paper's patient."""

from eclsim.circuit import Choice, Circuit
from eclsim.circuit.network import Control, Reading
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import POSITIONS, ecmo
from eclsim.devices.lvad import lvad
from eclsim.orbit.model import Model, nominal_values
from eclsim.parameters.thiel2025 import TABLE_S4
from eclsim.patient.circulation import Anatomy, circulation
from user_components import SetPointControl

PLACES = tuple(POSITIONS.values())
SCHEMES = {
    "a": ("ecmotupo", "ecmooxy"),
    "b": ("ecmooxy", "ecmotudp"),
    "c": ("ecmotuor", "ecmotudp"),
    "d": ("ecmotuor", "ecmoreturn"),
    "e": ("ecmooxy", "ecmoreturn"),
    "f": ("ecmooxy", "ecmotuor"),
    "g": ("ecmotuor", "ecmooxy"),
    "h": ("ecmotudp", "ecmodrain"),
    "i": ("ecmotupo", "ecmotudp"),
}
"""Access and return site of the CRRT connection schemes of the paper's Figure 2."""

PATIENT = TABLE_S4 | {"heart_rate_bpm": 120.0, "total_blood_volume_ml": 3427.0}
DEVICES = {"ecmo.speed_rpm": 3425.0, "ecmo.drainage_fr": 21.0, "ecmo.return_fr": 17.0}

CHOSEN_SITES = crrt(Choice(PLACES, "crrt.access_site"), Choice(PLACES, "crrt.return_site"))
REGIONS = Anatomy(True, True, frozenset({"aortic"}), frozenset({"mitral"}))
"""A patient in regions with bronchial return, a leaking and a stenosed valve."""
WALLS = Anatomy(collapsible_veins=True, pericardium=True)
CIRCUITS: dict[str, Circuit] = {
    "none": circulation(),
    "V-A": circulation() + ecmo("ra", "ao"),
    "V-V": circulation() + ecmo("svn", "ra", return_cannula="venous"),
    "V-A, roller pump": circulation() + ecmo("ra", "ao", roller=True),
    "V-A, CRRT g": circulation() + ecmo("ra", "ao") + crrt(*SCHEMES["g"]),
    "V-A, CRRT anywhere": circulation() + ecmo("ra", "ao") + CHOSEN_SITES,
    "CRRT at the patient": circulation() + crrt("svn", "ra"),
    "LVAD": circulation() + lvad(),
    "regions, femoral V-A": circulation(REGIONS) + ecmo("ivc", "lower"),
    "veins, pericardium, V-A": circulation(WALLS) + ecmo("ra", "ao"),
    "all together": circulation() + ecmo("ra", "ao") + crrt(*SCHEMES["g"]) + lvad(),
}


def model(name: str, **changes: float) -> Model:
    """The paper's patient in one of the configurations."""
    circuit = CIRCUITS[name]
    nominal = nominal_values(circuit)
    assert nominal is not None
    values = {key: (PATIENT | DEVICES).get(key, value) for key, value in nominal.items()}
    return Model(circuit, values, name).with_values(changes)


def scheme_sites(scheme: str) -> dict[str, float]:
    """Values of the parameters that choose the CRRT sites of "V-A, CRRT anywhere"."""
    access, giving = SCHEMES[scheme]
    return {
        "crrt.access_site": float(PLACES.index(access)),
        "crrt.return_site": float(PLACES.index(giving)),
    }


def regulated(
    name: str,
    reading: Reading,
    set_point: float,
    acts_on: tuple[str, ...] = ("Rmc",),
    raises: tuple[bool, ...] = (True,),
) -> Model:
    """The paper's patient with a controller that moves parameters until a reading is at a set point."""
    law = SetPointControl("set_point", "gain", raises)
    circuit = CIRCUITS[name] + Circuit(controllers=(Control("reflex", law, (reading,), acts_on),))
    return Model(circuit, {**model(name).values, "set_point": set_point, "gain": 0.2}, name)
