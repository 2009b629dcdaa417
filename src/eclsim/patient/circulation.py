"""The patient: heart, systemic and pulmonary circulation as tables of compartments and connections.

      +--> la --MV--> lv --AV--> ao ==> sart ==> svn --> ra --TV--> rv --PV--> pas ==> part ==> pvn --+
      +------------------------------------------------------------------------------------------------+
      ==> flow with inertia, --> without

An `Anatomy` adds to it: regions (`eclsim.patient.regional`), bronchial return, valves of a given area,
leaking valves, collapsible veins, a pericardium. Without it the tables are the published ones.

Sources: Thiel et al., section 2.2 and Table S-1; Shi et al. 2009 for `shi_hose_circulation`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from eclsim.circuit.network import (
    BLOOD_VOLUME,
    Circuit,
    Compartment,
    Connection,
    Exchange,
    StartPressure,
    StartVolume,
    Surrounding,
)
from eclsim.components import (
    Artery,
    AtrialBump,
    Atrium,
    CollapsibleChamber,
    CollapsibleVein,
    Complement,
    ElasticVessel,
    HeartValve,
    LeakingValve,
    LinearChamber,
    NativeLung,
    Orifice,
    Path,
    Pericardium,
    Resistance,
    Scaled,
    Tissue,
    Ventricle,
    VentricularSystole,
)
from eclsim.components.base import Key
from eclsim.parameters.fluid import CARBON_DIOXIDE_STORES_HOLD, SOLUTES
from eclsim.parameters.physiology import BRONCHIAL, CAVAL_BLOOD, CAVAL_SHARE, SECTION, VALVES
from eclsim.patient import regional
from eclsim.patient.sites import DRAINED

FLOW_COEFFICIENTS = {"tricuspid": "CQtri", "pulmonary": "CQpa", "mitral": "CQmi", "aortic": "CQao"}
"""Published flow coefficient of each valve."""

SHI_HOSE_NAMES = {"pas": "pas", "part": "pat", "pvn": "pvn", "ao": "sas", "sart": "sat", "svn": "svn"}
"""Name of each vessel in eclsim, and in the parameter set of Shi and Hose."""


@dataclass(frozen=True)
class Anatomy:
    """Parts of a patient beyond the published circulation.

    Args:
        regional: whether it has upper and lower body, aortic arch, descending aorta and two venae cavae.
        bronchial: whether it has a path from systemic arteries to pulmonary veins.
        regurgitant: valves that leak ("aortic", "mitral", "tricuspid", "pulmonary").
        stenosed: valves with an orifice area of their own in place of the published coefficient.
        collapsible_veins: whether the thoracic vena cava collapses when drained and the right heart can be
            empty.
        pericardium: whether a pericardium adds its pressure to all four chambers.
    """

    regional: bool = False
    bronchial: bool = False
    regurgitant: frozenset[str] = frozenset()
    stenosed: frozenset[str] = frozenset()
    collapsible_veins: bool = False
    pericardium: bool = False

    def valve(self, name: str) -> Path:
        """Law of a valve."""
        published, area = FLOW_COEFFICIENTS[name], f"{SECTION}.{name}_{{}}_cm2"
        coefficient = Orifice(area.format("stenosis")) if name in self.stenosed else published
        if name in self.regurgitant:
            return LeakingValve(coefficient, Orifice(area.format("regurgitation")))
        return HeartValve(coefficient)


def circulation(anatomy: Anatomy | None = None) -> Circuit:
    """Circulation of Thiel et al.: ten compartments, ten connections, 14 states.

    Args:
        anatomy: parts of the patient beyond the published circulation.
    """
    anatomy = anatomy or Anatomy()
    body = regional.systemic(anatomy.bronchial) if anatomy.regional else _systemic(anatomy.bronchial)
    patient = _heart_and_lungs(anatomy) + body
    if anatomy.collapsible_veins:
        patient = with_collapsible_veins(patient)
    return patient + Circuit(surroundings=(_pericardium(),)) if anatomy.pericardium else patient


def _pericardium() -> Surrounding:
    """Pericardium around the four chambers; vessels within it are neglected."""
    law = Pericardium("pericardium_mmHg", "pericardium_ml", "pericardium_scale_ml")
    return Surrounding("pericardium", law, ("ra", "rv", "la", "lv"))


def _systemic(bronchial: bool) -> Circuit:
    """Aorta, systemic arteries and veins."""
    organs = Artery(("Rsart", "Rmc"), "Lsart")
    if bronchial:
        rest = (Complement(BRONCHIAL),)
        organs = Artery(Scaled(("Rsart", "Rmc"), (), rest), Scaled("Lsart", (), rest))
    connections = (
        Connection("ao", Artery("Rao", "Lao"), "ao", "sart"),
        Connection("sart", organs, "sart", "svn"),
        Connection("svn", Resistance("Rsvn"), "svn", "ra"),
    )
    beside = (regional.bronchial_return("sart"),) if bronchial else ()
    return Circuit((_vessel("ao"), _vessel("sart"), _vessel("svn")), connections + beside)


def _heart_and_lungs(anatomy: Anatomy) -> Circuit:
    """Four chambers and the pulmonary circulation."""
    compartments = (
        Compartment("ra", Atrium("Edra", "Emaxra"), start=_share("ra")),
        Compartment(
            "rv", Ventricle("Emaxrv", "RV_Pd_alpha", "RV_Pd_kappa", "RV_Pd_beta"), start=_share("rv")
        ),
        _vessel("pas"),
        _vessel("part"),
        _vessel("pvn"),
        Compartment("la", Atrium("Edla", "Emaxla"), start=_share("la")),
        Compartment(
            "lv", Ventricle("Emaxlv", "LV_Pd_alpha", "LV_Pd_kappa", "LV_Pd_beta"), start=_share("lv")
        ),
    )
    valves = {chamber: anatomy.valve(name) for name, chamber in VALVES.items()}
    connections = (
        Connection("ra", valves["ra"], "ra", "rv"),
        Connection("rv", valves["rv"], "rv", "pas"),
        Connection("pas", Artery("Rpas", "Lpas"), "pas", "part"),
        Connection("part", Artery(("Rpart", "Rpmc"), "Lpart"), "part", "pvn"),
        Connection("pvn", Resistance("Rpvn"), "pvn", "la"),
        Connection("la", valves["la"], "la", "lv"),
        Connection("lv", valves["lv"], "lv", "ao"),
    )
    return Circuit(compartments, connections)


def gas_exchanges(anatomy: Anatomy | None = None, stores: bool = False) -> Circuit:
    """Exchanges of oxygen and carbon dioxide in the patient, to be added to the circulation.

    Args:
        anatomy: parts of the patient beyond the published circulation.
        stores: whether stores of carbon dioxide can fix the tissues' PCO2.
    """
    upper = f"{SECTION}.upper_share"
    places: dict[str, tuple[str, Key]] = {"tissue": ("sart", 1.0)}
    if anatomy is not None and anatomy.regional:
        places = {"upper_tissue": ("upper", upper), "lower_tissue": ("lower", Complement(upper))}
    tissues = []
    for name, (at, share) in places.items():
        law = Tissue(share=share)
        if stores:
            law = replace(law, held=CARBON_DIOXIDE_STORES_HOLD, stored=f"{SOLUTES}.{name}_pco2_mmHg")
        tissues.append(Exchange(name, law, at))
    return Circuit(exchanges=(*tissues, Exchange("lung", NativeLung(), "part")))


def shi_hose_circulation() -> Circuit:
    """Circulation of Shi et al. 2009 (CellML): linear chambers with rest volume and pressure.

    A code-verification case (its pulmonary pressure is not that of a healthy adult). Parameters:
    `eclsim.parameters.shi_hose2009`.
    """
    ventricle = VentricularSystole(peak=0.3, end=0.45)
    atrium = AtrialBump(start=0.92, length=0.09)
    chambers = {
        name: Compartment(
            name,
            LinearChamber(f"Emin{name}", f"Emax{name}", f"v0{name}", f"p0{name}", timing),
            start=StartVolume(f"V0{name}"),
        )
        for name, timing in {"ra": atrium, "rv": ventricle, "la": atrium, "lv": ventricle}.items()
    }
    vessels = {
        name: Compartment(name, ElasticVessel("C" + key), start=StartPressure("P0" + key))
        for name, key in SHI_HOSE_NAMES.items()
    }
    parts = chambers | vessels
    order = ("ra", "rv", "pas", "part", "pvn", "la", "lv", "ao", "sart", "svn")
    connections = (
        Connection("ra", HeartValve("CQtri"), "ra", "rv"),
        Connection("rv", HeartValve("CQpa"), "rv", "pas"),
        Connection("pas", Artery("Rpas", "Lpas"), "pas", "part"),
        Connection("part", Artery(("Rpat", "Rpar", "Rpcp"), "Lpat"), "part", "pvn"),
        Connection("pvn", Resistance("Rpvn"), "pvn", "la"),
        Connection("la", HeartValve("CQmi"), "la", "lv"),
        Connection("lv", HeartValve("CQao"), "lv", "ao"),
        Connection("ao", Artery("Rsas", "Lsas"), "ao", "sart"),
        Connection("sart", Artery(("Rsat", "Rsar", "Rscp"), "Lsat"), "sart", "svn"),
        Connection("svn", Resistance("Rsvn"), "svn", "ra"),
    )
    return Circuit(tuple(parts[name] for name in order), connections)


def _share(name: str) -> StartVolume:
    return StartVolume("volume_fraction_" + name, BLOOD_VOLUME)


def _vessel(name: str) -> Compartment:
    vessel = ElasticVessel("C" + name)
    return Compartment(
        name, vessel, start=StartPressure("P0" + name), total_fraction="volume_fraction_" + name
    )


# --- veins that collapse ----------------------------------------------------------------------------


PUBLISHED_VENOUS_MMHG = 4.0
"""Start pressure of the published veins [mmHg], at which `caval_resistance_share` holds."""
_RESISTANCE = "caval_resistance_share"
_RIGHT_HEART = ("ra", "rv")


def with_collapsible_veins(circuit: Circuit) -> Circuit:
    """Make the veins next to the heart collapsible and keep right heart volumes above zero.

        svn ----> tvc --[ R(V) ]--> ra          svc, ivc ----> tsvc, tivc --[ R(V) ]--> ra
        (veins)   (thoracic vena cava)          (in regions)

    The vena cava takes its compliance and its resistance from the published veins. Veins filled to the
    published 4 mmHg then have the same total compliance, stressed blood and resistance as without it. Below
    that pressure it collapses, and the right heart can be empty, whereas the published laws continue to
    negative volumes. Devices that are connected to the veins draw from the vena cava, through its resistance.

    Sources of the values: `eclsim.parameters.physiology`.
    """
    veins = {c.name: c for c in circuit.compartments if c.name in DRAINED}
    stores, paths = list[Compartment](), list[Connection]()
    for store in circuit.compartments:
        if store.name in veins:
            stores += _split_vein(store, circuit.connection(store.name))
        else:
            emptied = CollapsibleChamber(store.component, "chamber_emptying_ml")
            stores.append(replace(store, component=emptied) if store.name in _RIGHT_HEART else store)
    for path in circuit.connections:
        paths += _split_outlet(path) if path.name in veins else [path]
    return replace(circuit, compartments=tuple(stores), connections=tuple(paths))


def _scaled(total: Key, share: Key) -> Scaled:
    """A share of a key, which may itself be a share."""
    return replace(total, by=(*total.by, share)) if isinstance(total, Scaled) else Scaled(total, (share,))


def _split_vein(vein: Compartment, path: Connection) -> tuple[Compartment, Compartment]:
    """Split veins into the veins without the vena cava, and the vena cava."""
    law, inlet = vein.component, path.component
    assert isinstance(law, ElasticVessel)
    assert isinstance(inlet, Resistance)
    assert vein.total_fraction is not None
    divided = replace(
        vein,
        component=replace(law, compliance=_scaled(law.compliance, Complement(CAVAL_SHARE))),
        total_fraction=_scaled(vein.total_fraction, Complement(CAVAL_BLOOD)),
    )
    regions = law.compliance.by if isinstance(law.compliance, Scaled) else ()
    cava = CollapsibleVein(
        _scaled(law.compliance, CAVAL_SHARE), Scaled("caval_rest_volume_ml", regions), "caval_collapse_mmHg",
        _scaled(inlet.ohmic, _RESISTANCE), PUBLISHED_VENOUS_MMHG,
    )  # fmt: skip
    return divided, Compartment(DRAINED[vein.name], cava, start=vein.start)


def _split_outlet(path: Connection) -> tuple[Connection, Connection]:
    """Split the outlet of veins into a path to the vena cava and one from there to the former target."""
    assert isinstance(path.component, Resistance)
    inlet = Resistance(_scaled(path.component.ohmic, Complement(_RESISTANCE)))
    cava = DRAINED[path.name]
    return replace(path, component=inlet, target=cava), Connection(cava, Resistance(0.0), cava, path.target)
