"""Regional circulation: aortic arch, descending aorta, upper and lower body, two venae cavae.

                       +==> upper ==> svc --+
    lv --AV--> ao ==> arch                  +--> ra
                       +==> descending ==> lower ==> ivc --+
    ==> flow with inertia, --> without

The parameters of the published circulation keep their meaning as totals. With the upper body's share s of the
flow, a path that serves one region has 1/s or 1/(1 - s) times the published resistance and inertance, so that
both regions in parallel have the published ones and, at equal pressures, shares s and 1 - s of the flow. Part
of the aorta's resistance and inertance (Rao, Lao) is before the branches of the arch and carries all flow;
the rest is after them and divided likewise, so that the pressure drop from the root to either body is the
published one. Compliances are divided by fixed shares that add to 1, so that in steady flow the stressed
volumes are also the published ones.

The difference from the published patient is that the parts of a vessel no longer share one pressure, which
affects the pulsation within a beat and the effect of a device on one region.

Sources of the shares: `eclsim.parameters.physiology`.
"""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Compartment, Connection, StartPressure
from eclsim.components import Artery, Complement, ElasticVessel, Resistance, Scaled
from eclsim.components.base import Key
from eclsim.parameters.physiology import BRONCHIAL, UPPER_SHARE

_UPPER, _LOWER = UPPER_SHARE, Complement(UPPER_SHARE)
_DESCENDING_SHARE = Complement("ascending_drop_share")
_IN_ARTERIES = ("arch", "descending", "upper")
_ARTERIES = tuple(f"{name}_vessel_share" for name in _IN_ARTERIES)


def systemic(bronchial: bool = False) -> Circuit:
    """Systemic circulation in regions: seven compartments and their connections up to the right atrium.

    Args:
        bronchial: whether bronchial arteries branch off the descending aorta.
    """
    organs = (Complement(BRONCHIAL),) if bronchial else ()
    connections = (
        _artery("ao", "Rao", "Lao", "ao", "arch", by=("ascending_drop_share",)),
        _artery("archupper", "Rao", "Lao", "arch", "upper", by=(_DESCENDING_SHARE,), over=(_UPPER,)),
        _artery(
            "arch", "Rao", "Lao", "arch", "descending", by=(_DESCENDING_SHARE, "descending_drop_share"),
            over=(_LOWER,),
        ),
        _artery(
            "descending", "Rao", "Lao", "descending", "lower",
            by=(_DESCENDING_SHARE, Complement("descending_drop_share")), over=(_LOWER,),
        ),
        _artery("upper", ("Rsart", "Rmc"), "Lsart", "upper", "svc", over=(_UPPER, *organs)),
        _artery("lower", ("Rsart", "Rmc"), "Lsart", "lower", "ivc", over=(_LOWER, *organs)),
        Connection("svc", Resistance(Scaled("Rsvn", (), (_UPPER,))), "svc", "ra"),
        Connection("ivc", Resistance(Scaled("Rsvn", (), (_LOWER,))), "ivc", "ra"),
    )  # fmt: skip
    beside = (bronchial_return("descending"),) if bronchial else ()
    compartments = (
        _vessel("ao", "ao", 1.0),
        *(_vessel(name, "sart", share) for name, share in zip(_IN_ARTERIES, _ARTERIES, strict=True)),
        _vessel("lower", "sart", Complement(_ARTERIES)),
        _vessel("svc", "svn", "svc_vessel_share"),
        _vessel("ivc", "svn", Complement("svc_vessel_share")),
    )
    return Circuit(compartments, connections + beside)


def bronchial_return(artery: str) -> Connection:
    """Bronchial arteries, with their share of the systemic conductance, which bypass the right heart."""
    return Connection("bronchial", Resistance(Scaled(("Rsart", "Rmc"), (), (BRONCHIAL,))), artery, "pvn")


def _artery(
    name: str, ohmic: Key, inertia: Key, source: str, target: str, by: tuple[Key, ...] = (),
    over: tuple[Key, ...] = (),
) -> Connection:  # fmt: skip
    """A path with a share of a published resistance and inertance."""
    return Connection(name, Artery(Scaled(ohmic, by, over), Scaled(inertia, by, over)), source, target)


def _vessel(name: str, total: str, share: Key) -> Compartment:
    """A vessel with a share of the published compliance and blood, filled to the published pressure."""
    return Compartment(
        name,
        ElasticVessel(Scaled("C" + total, (share,))),
        start=StartPressure("P0" + total),
        total_fraction=Scaled("volume_fraction_" + total, (share,)),
    )
