"""Words for compartments and connections in figures: the patient's, in flow order, and those of devices."""

from collections.abc import Iterable

from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, naming_of

COMPARTMENTS = {
    "ao": "aorta",
    "sart": "systemic arteries",
    "svn": "systemic veins",
    "arch": "aortic arch",
    "descending": "descending aorta",
    "upper": "upper body arteries",
    "lower": "lower body arteries",
    "svc": "superior vena cava",
    "ivc": "inferior vena cava",
    "tvc": "thoracic vena cava",
    "tsvc": "thoracic superior vena cava",
    "tivc": "thoracic inferior vena cava",
    "pericardium": "pericardium",
    "ra": "right atrium",
    "rv": "right ventricle",
    "pas": "pulmonary sinus",
    "part": "pulmonary arteries",
    "pvn": "pulmonary veins",
    "la": "left atrium",
    "lv": "left ventricle",
}

CONNECTIONS = {
    "ao": "aorta",
    "sart": "organs",
    "svn": "venous return",
    "arch": "descending aorta",
    "archupper": "arch vessels",
    "descending": "iliac arteries",
    "upper": "upper body",
    "lower": "lower body",
    "svc": "superior vena cava",
    "ivc": "inferior vena cava",
    "tvc": "thoracic vena cava",
    "tsvc": "thoracic superior vena cava",
    "tivc": "thoracic inferior vena cava",
    "bronchial": "bronchial return",
    "ra": "tricuspid valve",
    "rv": "pulmonary valve",
    "pas": "pulmonary artery",
    "part": "lungs",
    "pvn": "pulmonary veins",
    "la": "mitral valve",
    "lv": "aortic valve",
}


def naming_at(place: str) -> Naming | None:
    """The instance of a device that a compartment or connection belongs to; None for the patient's."""
    key, _, rest = place.partition(".")
    if rest:
        return naming_of(f"{key}.{rest.partition('.')[0]}")
    return next((one for one in map(Naming, devices().values()) if one.device_place(place)), None)


def instances_at(places: Iterable[str]) -> list[Naming]:
    """The instances of devices that compartments or connections belong to, in the order of the registry."""
    result = {one.key: one for place in places if (one := naming_at(place)) is not None}
    order = list(devices())
    return sorted(result.values(), key=lambda one: order.index(one.device.key))


def place_words(signal: str) -> str:
    """What the place of a waveform is called."""
    kind, place = signal[0], signal[1:]
    names = naming_at(place)
    if kind == "P" and (place.endswith("pump") or (names is not None and place in names.pumps())):
        return "pressure rise over the pump"
    if names is not None:
        return names.place_label(signal)
    return (CONNECTIONS if kind == "Q" else COMPARTMENTS).get(place, place)
