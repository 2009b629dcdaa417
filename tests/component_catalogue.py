"""One instance of every component with values of its parameters, for tests that hold for all of them."""

from eclsim.components import (
    Artery,
    AtrialBump,
    Atrium,
    Balloon,
    Cannula,
    CollapsibleChamber,
    CollapsibleVein,
    ElasticVessel,
    HeartValve,
    LeakingValve,
    LinearChamber,
    OpenOrifice,
    Orifice,
    Path,
    Resistance,
    RollerPump,
    RotaryPump,
    Storage,
    Tube,
    Ventricle,
)
from eclsim.devices import ecmo, lvad
from eclsim.devices.cannulae import CANNULAE

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}

# Twice the default load of a patient, where flows are; [mL/s], forwards and backwards.
FLOWS = (-150.0, 250.0)

STORAGES: dict[str, tuple[Storage, dict[str, float]]] = {
    "vessel": (ElasticVessel("C"), {"C": 0.9}),
    "vessel with an unstressed volume": (ElasticVessel("C", "Vu"), {"C": 0.9, "Vu": 20.0}),
    "collapsible vein": (
        CollapsibleVein("C", "V0", "Pc", "R", 4.0),
        {"C": 6.67, "V0": 55.0, "Pc": -5.0, "R": 0.005},
    ),
    "collapsible chamber": (
        CollapsibleChamber(Atrium("Ed", "Emax"), "Ve"),
        {"Ed": 0.2, "Emax": 0.45, "Ve": 30.0},
    ),
    "atrium": (Atrium("Ed", "Emax"), {"Ed": 0.2, "Emax": 0.45}),
    "ventricle": (
        Ventricle("Emax", "alpha", "kappa", "beta"),
        {"Emax": 1.8, "alpha": 0.064, "kappa": 0.033, "beta": 2.5},
    ),
    "linear chamber": (
        LinearChamber("Emin", "Emax", "v0", "p0", AtrialBump(0.92, 0.09)),
        {"Emin": 0.1, "Emax": 2.5, "v0": 5.0, "p0": 1.0},
    ),
    "balloon": (Balloon("gas", "phase"), {"gas": 40.0, "phase": 0.36}),
}

PATHS: dict[str, tuple[Path, dict[str, float]]] = {
    "resistance": (Resistance(("R", "more")), {"R": 0.01, "more": 0.5}),
    "artery": (Artery(("R", "more"), "L"), {"R": 0.05, "more": 0.5, "L": 0.0017}),
    "tube": (Tube("l", "d"), {"l": 200.0, "d": 0.9625, "etaB": 0.003, "rhoB": 0.00106}),
    "valve": (HeartValve("CQ"), {"CQ": 350.0}),
    "stenosed valve": (HeartValve(Orifice("area")), {"area": 0.8, "rhoB": 0.00106}),
    "hole": (OpenOrifice(Orifice("area")), {"area": 0.5, "rhoB": 0.00106}),
    "leaking valve": (
        LeakingValve("CQ", Orifice("area")),
        {"CQ": 350.0, "area": 0.3, "rhoB": 0.00106},
    ),
    "venous cannula": (Cannula("fr", CANNULAE["venous"].coefficients), {"fr": 21.0}),
    "arterial cannula": (Cannula("fr", CANNULAE["arterial"].coefficients), {"fr": 17.0}),
    "clamped cannula": (
        Cannula("fr", CANNULAE["arterial"].coefficients, "clamp"),
        {"fr": 17.0, "clamp": 0.4},
    ),
    "crrt roller pump": (RollerPump("rate"), {"rate": 200.0}),
    "ecmo roller pump": (RollerPump("rate", "l/min"), {"rate": 4.0}),
}
for _name, _pump in PUMPS.items():
    _law = RotaryPump("w", "pump.", periphery=_pump.use == "LVAD")
    _speed = sum(_pump.speed_range_rpm) / 2
    PATHS[_name] = (_law, {"w": _speed} | {"pump." + key: value for key, value in _pump.constants.items()})

ROTARY_PUMPS = tuple(PUMPS)
ONE_WAY = tuple(name for name, (law, _) in PATHS.items() if law.one_way)
GIVEN_FLOW = tuple(name for name, (law, _) in PATHS.items() if law.given_flow)
