"""Cannulae of ECMO circuits: HLS cannulae of the published model, and dual-lumen cannulae.

A dual-lumen cannula has two entries, one for each lumen: `avalon_drainage` and `avalon_return`. Their R is
fitted to polynomials that a third party read off the makers' charts (github.com/nickmmark/ecmo-calculations,
cannula_flow_v4.html), by least squares of pressures up to 160 to 250 (return) and 50 to 90 mmHg (drainage).
There R Q^2 misses them by at most 9 mmHg; the cubics are within 3 % of R at each size.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from eclsim.devices.description import CAUTION, Finding
from eclsim.devices.device import Naming
from eclsim.devices.products import CannulaType, by_key
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

AVALON_BLOOD = "the chart is of water, and blood of haematocrit 26 % needs 10 to 80 % more pressure"
_HLS = "unvalidated: no data of these cannulae found; others of one size differ by 30 %"
_CHART = "maker's chart (github.com/nickmmark/ecmo-calculations, cannula_flow_v4.html)"
_UNKNOWN = "unvalidated: fluid of the chart not stated"
_PERFUSION = "Pressure and flow properties of dual-lumen cannulae, Perfusion 2020"


def _lumen(
    key: str,
    product: str,
    sizes: tuple[int, ...],
    coefficients: tuple[float, float, float, float],
    evidence: str = _UNKNOWN,
) -> CannulaType:
    """One lumen of a dual-lumen cannula; `key` ends with its line."""
    return CannulaType(
        key=key, name=f"{product}, {key.rpartition('_')[2]} lumen", coefficients=coefficients,
        length_cm=MappingProxyType(dict.fromkeys(sizes)), evidence=evidence, source=_CHART,
        dual_lumen=product,
    )  # fmt: skip


_AVALON, _CRESCENT, _PROTEK = "Getinge Avalon Elite", "Medtronic Crescent", "LivaNova ProTek Duo"
_AVALON_FR, _CRESCENT_FR, _PROTEK_FR = (20, 23, 27, 31), (24, 26, 28, 30, 32), (29, 31)

CANNULAE = by_key(
    (
        CannulaType(
            key="arterial", name="Getinge HLS arterial",
            coefficients=(
                -0.030456333049244444, 1.9774531710227174, -43.294344692029995, 322.2590740213103,
            ),
            length_cm=MappingProxyType({15: 23, 17: 23, 19: 23, 21: 23, 23: 23}),
            evidence=_HLS,
        ),
        CannulaType(
            key="venous", name="Getinge HLS venous",
            coefficients=(
                -0.00036562314501620286, 0.06564659815559282, -2.910667319976905, 39.143496939439224,
            ),
            length_cm=MappingProxyType({19: 38, 21: 55, 23: 55, 25: 55, 29: 55}),
            evidence=_HLS,
        ),
        _lumen(
            "avalon_drainage", _AVALON, _AVALON_FR, (-0.018677, 1.665436, -49.95042, 506.3114),
            f"{AVALON_BLOOD} ({_PERFUSION})",
        ),
        _lumen(
            "avalon_return", _AVALON, _AVALON_FR, (-0.107146, 8.971669, -251.0871, 2360.405),
            f"blood needs about the pressure of the chart ({_PERFUSION})",
        ),
        _lumen("crescent_drainage", _CRESCENT, _CRESCENT_FR, (-0.006526, 0.610055, -19.26254, 207.0626)),
        _lumen("crescent_return", _CRESCENT, _CRESCENT_FR, (-0.031211, 2.863087, -88.51306, 928.0178)),
        _lumen("protek_drainage", _PROTEK, _PROTEK_FR, (0.0, 0.0, -0.099759, 6.025174)),
        _lumen("protek_return", _PROTEK, _PROTEK_FR, (0.0, 0.0, -3.985313, 131.0192)),
    )
)  # fmt: skip
"""Cannulae: arterial ones return; venous ones drain, and return in veno-venous ECMO."""
_IN_WATER = CANNULAE["avalon_drainage"].coefficients


def fits_line(line: str) -> tuple[str, ...]:
    """Names of the cannulae for a line, "drainage" or "return"."""
    return tuple(key for key, kind in CANNULAE.items() if not kind.dual_lumen or key.endswith(f"_{line}"))


def check_lumens(key: str, values: Raw, remarks: Remarks) -> None:
    """Warn where the lines of a section `key` are not the two lumens of one cannula."""
    drainage, back = (CANNULAE.get(values.get(f"{line}_cannula", "")) for line in ("drainage", "return"))
    if drainage is None or back is None or not (drainage.dual_lumen or back.dual_lumen):
        return
    if drainage.dual_lumen != back.dual_lumen:
        named = " and ".join(f"{kind.key} ({kind.name})" for kind in (drainage, back))
        remarks.warning(f"{key}.return_cannula", f"the lines are not lumens of one cannula: {named}")
    elif values.get("drainage_fr") != values.get("return_fr"):
        message = f"both lumens of a {back.dual_lumen} have one size; drainage_fr is another"
        remarks.warning(f"{key}.return_fr", message, shown(values.get("return_fr")))


def caution_on_chart(names: Naming, outputs: Mapping[str, float], circuit: Circuit) -> list[Finding]:
    """Caution on pressures of a drainage lumen whose chart was measured in water."""
    laws = (c.component for c in circuit.connections if c.name == names.place("ecmodrain"))
    in_water = any(getattr(law, "coefficients", ()) == _IN_WATER for law in laws)
    suction = ("lowest_drainage_pressure", "drainage_pressure", "pump_inlet_pressure")
    concerns = tuple(name for name in map(names.output, suction) if name in outputs)
    if not in_water or not concerns:
        return []
    text = f"pressures of the {names.label} before its pump are too mild: {AVALON_BLOOD}"
    return [Finding.without_limit(CAUTION, concerns[0], outputs[concerns[0]], text, *concerns)]
