"""Fluid, suction and carbon dioxide stores compared with measurements in people and animals.

The filtration coefficient was fitted to dialysis patients by its authors; nothing was fitted here. Pressures
come from steady beats at several blood volumes, with the reflex on, and are interpolated during the course.
Healthy men have the veins of another model and start with the pressures of the men who were measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.devices.ecmo import ECMO
from eclsim.fluid.law import PLASMA, RED_CELLS, REFILLED, fluid_law
from eclsim.orbit.model import PATIENT_HELD, Model, model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.results import simulate, simulate_many
from eclsim.outputs.steady_beat import steady_beat
from eclsim.paper.comparison import YES_NO, Check, Explanation, Row, within
from eclsim.parameters.fluid import LYMPH_PUMP
from eclsim.parameters.regulation import EXTRA_VOLUME, SET_POINT, VENOUS_SET_POINT
from eclsim.regulation.attach import REFLEXES
from eclsim.regulation.heldt import HELDT_2010
from eclsim.slow import INFLOWS
from eclsim.validation.gas import not_significant_in_five
from eclsim.validation.matching import with_cardiopulmonary, with_outputs
from eclsim.validation.reference_cases import PROTOCOLS, compared, sign

PIETRIBIASI = "Pietribiasi et al. 2016 (PMID 27483369), dialysis patients, abstract"
KEANE = "Keane et al. 2018 (10.1097/MAT.0000000000000795), 47 dialysis patients, abstract"
DASSELAAR = "Dasselaar et al. 2006 (10.1097/01.mat.0000199896.27003.98), 8 dialysis patients, abstract"
LUNDVALL = (
    "Lundvall et al., Rapid plasma volume decline upon quiet standing (Acta Physiol Scand), 7 men, abstract"
)
LYING_DOWN = "Lundvall and Bjerkhoel 1995 (10.1111/j.1748-1716.1995.tb09895.x), 20 men, abstract"
HELDT = "Heldt 2004 (thesis), after older measurements"
LEE = "Lee and Lee 2022 (10.3390/toxins15010031), analysis of six studies of dialysis, abstract"
NIGHTS = (
    "Dynamics of vascular refilling in extended nocturnal hemodialysis (10.1111/hdi.13029), 10 patients, 7 h "
    "at 4.8 mL/kg/h, refilled: 23 % in the first hour, 73.6 % in 4 h and in all, abstract; 10 % as spread"
)
MENDES = "Mendes et al. 2016 (PMC4703593), apnoeic pigs, abstract"
VOLUMES_ML = np.linspace(-1500.0, 300.0, 10)
PUBLISHED, SPREAD = 10.0, 8.4
"""Mean filtration coefficient of dialysis patients and its standard deviation [mL/min/mmHg]."""
LOW_COEFFICIENT = PUBLISHED - SPREAD
LOWEST_COEFFICIENT = 0.43
"""Lowest coefficient in the source of the forces; its groups have 0.43, 1.29 and 5.93 mL/min/mmHg."""
NIGHT_ML_H = 4.8 * 75.0
"""Filtered in a long dialysis [mL/h]; 75 kg is the weight of a case that states none."""
SESSION_H = 4.0
"""Duration of a dialysis, which the abstracts do not state [h]."""
COLUMN_MMHG, LEGS = 58.5, 0.32
"""Hydrostatic pressure of legs 0.75 m below the heart [mmHg], and their share of the body."""
MMHG_PER_CM = 0.738
"""Hydrostatic pressure of blood [mmHg/cm]; this and the constants on standing below are from CVSim 1.0."""
CAROTID_MMHG = MMHG_PER_CM * 25.0
"""Hydrostatic pressure by which the carotid sinus, 25 cm above the heart, senses less [mmHg]."""
CHEST_MMHG = -3.5
"""Change of intrathoracic pressure [mmHg]; veins, arteries and capillaries outside have that much less."""


class Veins(NamedTuple):
    """Veins of a part of the body.

    Attributes:
        compliance: compliance at zero pressure [mL/mmHg].
        most: largest distension [mL].
        column: hydrostatic pressure relative to the heart on standing [mmHg].
    """

    compliance: float
    most: float
    column: float

    def volume(self, pressure: float) -> float:
        """Blood volume at a pressure [mL]."""
        return 2.0 * self.most / np.pi * np.arctan(0.5 * np.pi * self.compliance * pressure / self.most)


TO_HEART = MMHG_PER_CM * (6.0 / 2.0 + 14.5 / 3.0)
VEINS = (
    Veins(20.0, 1000.0, COLUMN_MMHG),  # legs
    Veins(60.0, 1500.0, TO_HEART + MMHG_PER_CM * 5.0 / 2.0),  # splanchnic organs
    Veins(5.0 + 1.3, 650.0, TO_HEART),  # kidneys, abdominal veins
    Veins(7.0, 1e6, -MMHG_PER_CM * (20.0 / 2.0 + 14.5 / 2.0)),  # head and arms, above the heart
)
"""In CVSim the legs have a column of 31.9 mmHg; here it is that of their capillaries."""
SOFT = {"Csvn": 7.0 + 1.3 + 5.0 + 60.0 + 20.0 + 1.3 + 0.5, "Cpvn": 9.0, "Cpart": 3.4}
"""Compliances of CVSim 1.0 [mL/mmHg]; those of its systemic veins are added."""
BEFORE = {"MAP": 89.5, "right_atrial_pressure": 5.8, "CO": 5.5, "PCWP": 8.0}
"""Men before a blood loss: pressures of the first six (heart rate 59); healthy output and wedge pressure."""
ULTRAFILTRATION_KEY = "uf"


class Patient:
    """A patient with known pressures at several blood volumes.

    Args:
        model: model of the patient.

    Attributes:
        values: outputs at the volumes `VOLUMES_ML`, supine.
        pooled_ml: blood in the veins of the legs on standing [mL].
    """

    def __init__(self, model: Model):
        self.model = model
        self.values = self._at_volumes(model)
        self.pooled_ml = pooled_ml(float(self.at(np.zeros(1))["venous_pressure"][0]))

    @cached_property
    def upright(self) -> dict[str, np.ndarray]:
        """Outputs on standing, relative to the atmosphere; pressures of beats are relative to the chest."""
        raised = {SET_POINT: self.model.values[SET_POINT] + CAROTID_MMHG - CHEST_MMHG}
        table = self._at_volumes(self.model.with_values(raised))
        return table | {name: table[name] + CHEST_MMHG for name in ("MAP", "venous_pressure")}

    @staticmethod
    def _at_volumes(model: Model) -> dict[str, np.ndarray]:
        volumes = {EXTRA_VOLUME: model.values[EXTRA_VOLUME] + VOLUMES_ML}
        names = (*fluid_law(model.circuit, model.values).reads, "unstressed_volume")
        beats = steady_beat(batch_of(model, volumes), names)
        return {name: beats.output(name) for name in names}

    def at(self, change: np.ndarray, upright: bool = False) -> dict[str, np.ndarray]:
        """Outputs after a change of blood volume [mL], with the reflex of a man who is supine or stands."""
        table = self.upright if upright else self.values
        return {name: np.interp(change, VOLUMES_ML, values) for name, values in table.items()}

    def course(
        self,
        hours: float,
        rates_ml_s: Mapping[str, float],
        stands: Callable[[float], bool] = lambda _: False,
        then: tuple[float, Mapping[str, float]] = (math.inf, {}),
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Compute minutes and slow states of a course.

        Args:
            hours: duration [h].
            rates_ml_s: rates of fluids given, of bleeding ("bleed_ml") and of filtration
                (`ULTRAFILTRATION_KEY`); also the lymphatics' pumping (`LYMPH_PUMP`) [-], by default 1.
            stands: whether the patient stands at a time [s]; leg veins then hold blood, and capillaries a
                column.
            then: a time [s] and the rates from that time on.
        """
        values, key = self.model.values, ULTRAFILTRATION_KEY
        law = replace(fluid_law(self.model.circuit, values), ultrafiltration=(key,))

        def settings_and_inflows(rates: Mapping[str, float]) -> tuple[dict[str, np.ndarray], ...]:
            given = {kind: rates.get(kind, 0.0) for kind in INFLOWS}
            changed = {key: 3600.0 * rates.get(key, 0.0), LYMPH_PUMP: rates.get(LYMPH_PUMP, 1.0)}
            return _arrays({**values, **changed}), _arrays(given)

        first, second = settings_and_inflows(rates_ml_s), settings_and_inflows(then[1])
        start = law.start(first[0], self.at(np.zeros(1)))
        names = list(start)

        def slope(time: float, y: np.ndarray) -> np.ndarray:
            states = {name: y[k : k + 1] for k, name in enumerate(names)}
            change = states[PLASMA] + states[RED_CELLS] - start[PLASMA] - start[RED_CELLS]
            up = float(stands(time))
            settings, inflows = first if time < then[0] else second
            beat = self.at(change - up * self.pooled_ml, stands(time))
            for name in ("MAP", "venous_pressure"):  # raises arteries and veins, hence capillaries
                beat[name] = beat[name] + up * LEGS * COLUMN_MMHG
            rates = law.rates(states, settings, beat, inflows)
            return np.concatenate([rates[name] for name in names])

        from scipy.integrate import solve_ivp

        begin = np.concatenate([start[name] for name in names])
        solution = solve_ivp(
            slope, (0.0, 3600.0 * hours), begin, "LSODA", rtol=1e-8, atol=1e-6, max_step=60.0
        )
        return solution.t / 60.0, dict(zip(names, solution.y, strict=True))


def pooled_ml(venous: float) -> float:
    """Blood [mL] pooled in veins outside the chest on standing, at a venous pressure at the heart [mmHg]."""
    return sum(one.volume(venous + CHEST_MMHG + one.column) - one.volume(venous) for one in VEINS)


def fluid_check() -> Check:
    """Compare fluid and carbon dioxide stores with measurements."""
    return compared("fluid", (*_filtration(), *_forces(), *_standing(), *_stores()))


def _filtration() -> list[Row]:
    """Rows for the blood volume during dialysis."""
    as_published, low = map(dialysed, (PUBLISHED, LOW_COEFFICIENT))

    def row(
        label: str, unit: str, expected: float, spread: float, litres: float, per: float, source: str
    ) -> Row:
        """Row for the fall of blood volume with the published mean; as evidence, with the low coefficient."""
        usual, tight = (fall_of_blood(patient, 1000.0 * litres) / per for patient in (as_published, low))
        reason = (
            "refill is too fast at the published mean of the filtration coefficient; at "
            f"{LOW_COEFFICIENT:.1f} mL/min/mmHg, one standard deviation lower, the fall is as measured"
        )
        return within(label, expected, usual, spread, unit, source=source).explained_by(reason, tight)

    return [
        within(
            "filtration coefficient (fit of the source)", PUBLISHED,
            as_published.model.values["fluid.filtration_ml_min_mmHg"], SPREAD, "mL/min/mmHg",
            source=PIETRIBIASI,
        ),
        row("fall of blood volume, 1.7 L filtered (test)", "%/h", 3.2, 1.6, 1.7, SESSION_H,
            f"{KEANE}; spread not printed, half of it taken"),
        row("the same for each L, 1.5 L filtered (test)", "%/L", 4.9, 1.3, 1.5, 1.5, DASSELAAR),
        row("the same for each L, 2.7 L filtered (test)", "%/L", 2.4, 0.8, 2.7, 2.7, DASSELAAR),
        *_nights(as_published, (LOWEST_COEFFICIENT, LOW_COEFFICIENT, LOW_COEFFICIENT)),
    ]  # fmt: skip


def night_rows(patient: Patient) -> list[Row]:
    """Rows for the share refilled in a long dialysis."""
    minutes, states = patient.course(7.0, {ULTRAFILTRATION_KEY: NIGHT_ML_H / 3600.0})
    rows = list[Row]()
    for hours, expected in ((1.0, 23.0), (4.0, 73.6), (7.0, 73.6)):
        share = 100.0 * float(np.interp(60.0 * hours, minutes, states[REFILLED])) / (hours * NIGHT_ML_H)
        label = f"{NIGHT_ML_H:g} mL/h filtered: share of it refilled in {hours:g} h (test)"
        rows.append(within(label, expected, share, 10.0, "%", source=NIGHTS))
    return rows


def _nights(usual: Patient, walls: Sequence[float]) -> Iterator[Row]:
    """The rows above, each with the wall of its experiment."""
    for k, (row, wall) in enumerate(zip(night_rows(usual), walls, strict=True)):
        reason = (
            "refill is too fast at the published mean of the filtration coefficient; at "
            f"{wall:.3g} mL/min/mmHg the share is as measured"
        )
        yield row.explained_by(reason, night_rows(dialysed(wall))[k].got)


def _person(age: float, rate: float, reflex: str | None = None, **sections: object) -> Model:
    """Return a man with the body of a case file."""
    body = {"id": "P", "sex": "male", "age_years": age, "heart_rate_bpm": rate}
    regulation = {"regulation": {"baroreflex": 1.0, "model": reflex}} if reflex else {}
    return model_of(read_mapping({"format": 1, "patient": body, "fluid": {}} | regulation | sections).case)


@lru_cache(maxsize=4)
def dialysed(coefficient: float, pericapillary_share: float = 1.0) -> Patient:
    """Return a patient on dialysis with 1.6 L of excess fluid."""
    blood = {"haematocrit": 0.33, "plasma_protein_g_dl": 6.8, "filtration_ml_min_mmHg": coefficient,
             "pericapillary_share": pericapillary_share}  # fmt: skip
    plain = _person(60.0, 75.0, fluid=blood).values["fluid.interstitial_volume_ml"]
    overloaded = blood | {"interstitial_volume_ml": plain + 1600.0}
    return Patient(_person(60.0, 75.0, "heldt2004", fluid=overloaded))


def fall_of_blood(patient: Patient, removed_ml: float) -> float:
    """Fall of the blood volume at the end of a session [%]."""
    blood, _ = _session(patient, removed_ml)
    return float(100.0 * (1.0 - blood[-1] / blood[0]))


def _session(patient: Patient, removed_ml: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Blood volume [mL] and slow states during a session."""
    _, states = patient.course(SESSION_H, {ULTRAFILTRATION_KEY: removed_ml / (3600.0 * SESSION_H)})
    return states[PLASMA] + states[RED_CELLS], states


def driven(patient: Patient, removed_ml: float) -> dict[str, float]:
    """Forces of refill at the end of a session: their sum [mmHg], and the share of each [%].

    The interstitial oncotic pressure is that of the mean concentration, as in the source.
    """
    settings = _arrays(patient.model.values)
    law = replace(fluid_law(patient.model.circuit, patient.model.values), has_pericapillary_layer=False)
    blood, states = _session(patient, removed_ml)
    last = {name: values[-1:] for name, values in states.items()}
    changed = law.forces(last, settings, patient.at(blood[-1:] - blood[0]))
    reflection = settings["fluid.reflection"]
    inward = {
        "oncotic pressure of the plasma": reflection * changed.plasma_oncotic,
        "pressure of capillaries": -changed.capillary,
        "oncotic pressure of the interstitium": -reflection * changed.interstitial_oncotic,
        "pressure of the interstitium": changed.interstitial,
    }
    total = float(sum(force.item() for force in inward.values()))
    return {"": total} | {name: 100.0 * force.item() / total for name, force in inward.items()}


DRIVES = (
    ("oncotic pressure of the plasma", 78.0, 6.0), ("pressure of capillaries", 32.0, 4.0),
    ("oncotic pressure of the interstitium", -6.0, 3.0), ("pressure of the interstitium", -5.0, 2.0),
)  # fmt: skip
"""Share of each force in the driving force of refill, and its spread [%]."""


def _forces() -> list[Row]:
    """Rows for the forces of refill in a dialysis of 1.7 L."""
    usual, tight = (driven(dialysed(k), 1700.0) for k in (PUBLISHED, LOWEST_COEFFICIENT))
    reason = (
        "at the published mean of the filtration coefficient small forces are enough for the refill; the "
        f"source found 0.43, 1.29 and 5.93 mL/min/mmHg in its three groups, and at {LOWEST_COEFFICIENT:g} "
        "the forces are as measured"
    )
    return [
        replace(row, explanation=Explanation(reason, (evidence,)))
        for row, evidence in zip(force_rows(usual), force_rows(tight), strict=True)
    ]


def force_rows(computed: Mapping[str, float]) -> list[Row]:
    """Rows comparing the result of `driven` with the analysis of six studies."""
    total = Row(
        "force that drives refill, 1.7 L filtered (test)", computed[""], 5.4, 20.3, "mmHg", source=LEE
    )
    return [total] + [
        within(f"its share by the {name} (test)", share, computed[name], spread, "%", source=LEE)
        for name, share, spread in DRIVES
    ]


STANDING_REFLEX = "heldt2010"


@lru_cache(maxsize=16)
def healthy(reflex: str, stiff_veins: bool = False, cardiopulmonary: bool = False, **changes: float) -> Model:
    """Return a young man with the pressures of those who were bled, which are also the set points.

    Args:
        reflex: name of the published set of reflex parameters.
        stiff_veins: whether vessels are those of the published patient instead of `SOFT`.
        cardiopulmonary: whether the reflex has the cardiopulmonary pathways of CVSim.
        changes: other parameters.
    """
    case = {
        "patient": {"id": "P", "sex": "male", "age_years": 25, "heart_rate_bpm": 59.0, "height_cm": 180,
                    "weight_kg": 75},
        "fluid": {"haematocrit": 0.45, "plasma_protein_g_dl": 7.0},
        "parameters": {} if stiff_veins else SOFT,
    }  # fmt: skip
    free = ("Rmc", EXTRA_VOLUME, "Emaxlv", "Rpmc")
    matched = with_outputs(_person(25.0, 59.0, **case).with_values(changes), free, BEFORE)
    regulated = _person(25.0, 59.0, HELDT_2010.name if cardiopulmonary else reflex, **case)
    if cardiopulmonary:
        regulated = with_cardiopulmonary(regulated, REFLEXES[reflex])
    points = {SET_POINT: BEFORE["MAP"], VENOUS_SET_POINT: BEFORE["right_atrial_pressure"]}
    values = {name: matched.values[name] for name in (*free, *changes)} | points
    return regulated.with_values({name: v for name, v in values.items() if name in regulated.values})


def stood(man: Patient) -> tuple[np.ndarray, np.ndarray, float]:
    """Plasma lost at 3, 5, 10, 35 min [%]; time constant [min]; half-time of return after 15 min [min]."""
    time, states = man.course(35.0 / 60.0, {}, lambda _: True)
    lost = 100.0 * (1.0 - states[PLASMA] / states[PLASMA][0])
    tau = float(np.interp((1.0 - np.exp(-1.0)) * lost[-1], lost, time))
    minutes, states = man.course(45.0 / 60.0, {}, lambda second: second < 900.0)
    out = states[PLASMA][0] - states[PLASMA]
    top = int(np.argmin(np.abs(minutes - 15.0)))
    back = float(np.interp(0.5, 1.0 - out[top:] / out[top], minutes[top:])) - 15.0
    return np.interp((3.0, 5.0, 10.0, 35.0), time, lost), np.array(tau), back


PLASMA_LOST = ((3, 8.5, 0.8), (5, 11.7, 0.8), (10, 16.8, 1.6), (35, 17.4, 1.8))
"""Minutes after standing up, plasma lost and its spread [%]."""


def _standing() -> list[Row]:
    """Rows for plasma lost on standing up, and regained on lying down."""
    lost, tau, back = stood(Patient(healthy(STANDING_REFLEX)))
    return [
        *(
            within(f"plasma lost on standing, {minute} min (test)", expected, got, spread, "%",
                   source=LUNDVALL)
            for (minute, expected, spread), got in zip(PLASMA_LOST, lost, strict=True)
        ),
        within("plasma lost on a tilt to 85 degrees (test)", 17.7, float(lost[-1]), 1.6, "%", source=HELDT),
        within("time constant of the loss on standing (test)", 4.6, float(tau), 0.8, "min", source=HELDT),
        Row("the same, other men in the literature (test)", float(tau), 4.0, 12.2, "min", source=HELDT),
        Row("half of it back after lying down, 15 min stood (test)", back, 0.0, 6.0, "min", 6.0,
            source=LYING_DOWN),
    ]  # fmt: skip


def _stores() -> list[Row]:
    """Rows for PaCO2 of an apnoeic patient after the sweep is increased from 3 to 10 L/min."""
    slow, fast = (_after_sweep(rpm) for rpm in (1400.0, 2500.0))
    settled = (fast[50] - fast[0]) / (fast[-1] - fast[0])
    return [
        within(
            "PaCO2 settled 50 min after a change of sweep, 3.5 L/min (test)", 100.0, 100.0 * settled,
            10.0, "%", source=MENDES,
        ),
        Row("3.5 L/min: sweep 3 to 10 L/min lowers PaCO2 (test)", float(fast[50] < fast[0] - 2.0), 1.0, 1.0,
            YES_NO, 1.0, source=MENDES),
        within(
            "1.5 L/min: change of PaCO2 with sweep 3 to 10 L/min (test)", 0.0, slow[50] - slow[0], 5.0,
            "mmHg", source=MENDES, explanation=not_significant_in_five(slow[0] - slow[50]),
        ),
    ]  # fmt: skip


def _after_sweep(rpm: float) -> np.ndarray:
    """PaCO2 for every minute, starting just before the change, and its final value [mmHg]."""
    pig = PROTOCOLS["apnoeic"]
    before, after = (
        pig | {ECMO.key: pig[ECMO.key] | {"speed_rpm": rpm, "sweep_l_min": sweep}} for sweep in (3.0, 10.0)
    )
    change = {"at_min": 1.0, "set": {f"{ECMO.key}.sweep_l_min": 10.0}}
    case, names = read_mapping(before | {"events": [change]}).case, ("PaCO2",)
    arterial = course(case, minutes=51.0, every_min=1.0, outputs=names)["PaCO2"]
    end = simulate(read_mapping(after).case)["PaCO2"]
    return np.array([*arterial.to_numpy()[[0, *range(3, 53)]], float(end)])


def batch_of(model: Model, columns: Mapping[str, np.ndarray]) -> Batch:
    """Return variants of a model that differ in some parameters."""
    count = len(next(iter(columns.values())))
    return Batch(model.circuit, {**model.values, **columns}, count, model.policy)


def _arrays(values: Mapping[str, float]) -> dict[str, np.ndarray]:
    return {key: np.array([value]) for key, value in values.items()}


# --- suction ----------------------------------------------------------------------------------------


SIMONS = (
    "Simons, Lindelauf, Ganushchak, Maessen and Weerwind, Perfusion: strategies to preserve stable "
    "extracorporeal life support flow during simulated hypovolaemia (abstract)"
)
COLLAPSED = "Molegraaf and others, venous collapse in a mock circulation and in animals (abstract)"
NORMAL_L_MIN, SHORT_L_MIN = 3.1, 2.3
SHORT_MMHG, SPREAD_MMHG = -114.0, 52.0
"""Flow with and without enough blood at one speed, and venous line pressure then with its spread [mmHg]."""
SPEED = f"{ECMO.key}.speed_rpm"
LOST_ML = -740.0
"""Start value of the search for the missing blood volume [mL]."""


def patient(collapsible: bool = True, volume_ml: float = 0.0) -> Model:
    """Return a patient on central V-A ECMO with a failing left ventricle and primed circuits.

    Bronchial return and a leaking tricuspid valve prevent closed valves from dividing the circulation.
    """
    case = {
        "format": 1,
        "blood_volume_policy": PATIENT_HELD,
        "patient": {
            "id": "P", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 75,
            "heart_rate_bpm": 90,
        },
        "physiology": {
            "bronchial_fraction": 0.015, "tricuspid_regurgitation_cm2": 0.05,
            "collapsible_veins": collapsible,
        },
        "fluid": {"extra_volume_ml": volume_ml},
        ECMO.key: {
            "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VA",
            "drainage_fr": 25, "return_fr": 19,
        },
        "parameters": {"Emaxlv": 0.7},
    }  # fmt: skip
    return model_of(read_mapping(case).case)


def suction_check() -> Check:
    """Compare suction at reduced flow, and the effect of higher speed on it."""
    filled = with_outputs(patient(), (SPEED,), {"PF": NORMAL_L_MIN})
    short = with_outputs(filled.with_values({EXTRA_VOLUME: LOST_ML}), (EXTRA_VOLUME,), {"PF": SHORT_L_MIN})
    pressure = float(simulate(short)["drainage_pressure"])
    label = f"loss of blood that lowers {NORMAL_L_MIN} to {SHORT_L_MIN} L/min: drainage pressure"
    gains = [_gain(model) for model in (filled, short)]
    rows = [
        within(label, SHORT_MMHG, pressure, SPREAD_MMHG, "mmHg", source=SIMONS),
        sign("a step of speed changes the flow less in collapse", -1.0, gains[1] - gains[0], COLLAPSED),
    ]  # fmt: skip
    return compared("suction", rows)


def _gain(model: Model) -> float:
    """Increase of flow per 1000 rpm [L/min]."""
    speed = model.values[SPEED]
    flows = simulate_many(model, {SPEED: [speed - 100.0, speed + 100.0]}, ["PF"])["PF"].values
    return 5.0 * float(flows[1] - flows[0])
