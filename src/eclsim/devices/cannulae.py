"""Cannulae of ECMO circuits: HLS cannulae of the published model, dual-lumen and second cannulae.

A dual-lumen cannula has two entries, one for each lumen: `avalon_drainage` and `avalon_return`. Their R is
fitted to polynomials that a third party read off the makers' charts (github.com/nickmmark/ecmo-calculations,
cannula_flow_v4.html), by least squares of pressures up to 160 to 250 (return) and 50 to 90 mmHg (drainage).
There R Q^2 misses them by at most 9 mmHg; the cubics are within 3 % of R at each size.

Second cannulae make V-VA and V-AV return, bicaval and left atrial (LAVA) drainage.

    second drainage site --(cannula)--> ecmodrain        ecmoreturn --(cannula, clamp)--> second return site

Each joins the line of the first cannula at a Y-piece. Their types follow from their sizes: drainage cannulae
are venous from 19 Fr on, return cannulae arterial up to 23 Fr. A clamp narrows the second return to a share
of its area: its resistance grows with the inverse square of the open share.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import SerializerFunctionWrapHandler, model_serializer

from eclsim.devices.description import (
    CAUTION,
    Control,
    Finding,
    Knob,
    Limit,
    Mark,
    Picker,
    mean_flow,
    picker,
)
from eclsim.devices.device import Naming
from eclsim.devices.plausibility import check_cannula, patient_site, pumps_back
from eclsim.devices.products import CannulaType, by_key
from eclsim.inputs.fields import number
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.patient.sites import ARTERIAL_SITES, LEFT_HEART, PATIENT_SITES

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit, Connection


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
        length_cm=dict.fromkeys(sizes), evidence=evidence, source=_CHART,
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
            length_cm={15: 23, 17: 23, 19: 23, 21: 23, 23: 23},
            evidence=_HLS,
        ),
        CannulaType(
            key="venous", name="Getinge HLS venous",
            coefficients=(
                -0.00036562314501620286, 0.06564659815559282, -2.910667319976905, 39.143496939439224,
            ),
            length_cm={19: 38, 21: 55, 23: 55, 25: 55, 29: 55},
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


TWO, OTHERS = "two", "others"
"""Choices of cannulae on the page besides the dual-lumen ones: one for each line, and no such pair."""
DUAL_LUMEN = {kind.key.rpartition("_")[0]: kind.dual_lumen for kind in CANNULAE.values() if kind.dual_lumen}
"""Names of the dual-lumen cannulae by the common beginning of the keys of their lumens."""


def chosen_cannulae(drainage: str, back: str) -> str:
    """The choice on the page to which the cannulae of both lines belong."""
    stems = [key.rpartition("_")[0] for key in (drainage, back)]
    if stems == ["", ""]:
        return TWO
    return stems[0] if stems[0] == stems[1] else OTHERS


def cannulae_picker(chosen: str) -> Picker:
    """Choice of two cannulae or of a dual-lumen one."""
    short = {key: name.partition(" ")[2] for key, name in DUAL_LUMEN.items()}  # without the maker
    labels = {TWO: "two, single-lumen", **short, OTHERS: "others"}
    return picker(
        "cannulae", "Cannulae", [key for key in labels if key in (chosen, TWO, *DUAL_LUMEN)], labels
    )


def with_dual_lumen(raw: dict[str, Any], chosen: str) -> dict[str, Any]:
    """The section with both lumens of a dual-lumen cannula, in the maker's size next to that of drainage."""
    keys = {f"{line}_cannula": f"{chosen}_{line}" for line in LINES}
    sizes = CANNULAE[keys["drainage_cannula"]].sizes_fr
    size = float(min(sizes, key=lambda one: (abs(one - raw["drainage_fr"]), -one)))
    return raw | keys | {f"{line}_fr": size for line in LINES}


def check_lumens(key: str, values: Raw, remarks: Remarks) -> None:
    """Warn where the lines of a section `key` are not the two lumens of one cannula."""
    drainage, back = (CANNULAE.get(values.get(f"{line}_cannula", "")) for line in ("drainage", "return"))
    if drainage is None or back is None or not (drainage.dual_lumen or back.dual_lumen):
        return
    if drainage.dual_lumen != back.dual_lumen:
        named = " and ".join(f"{kind.key} ({kind.name})" for kind in (drainage, back))
        remarks.warning(f"{key}.return_cannula", f"the lines are not lumens of one cannula: {named}")
    elif values.get("drainage_fr") != values.get("return_fr"):
        message = f"both lumens of a {back.dual_lumen} have one size; that for drainage is another"
        remarks.warning(f"{key}.return_fr", message, shown(values.get("return_fr")))


_NOT_RETURNED_TO = ("rv", *LEFT_HEART)
"""Sites to which no usual mode of ECMO returns blood."""


def check_vessels(key: str, values: Raw, remarks: Remarks) -> None:
    """Warn of cannulae in vessels into which they are not put: topology is free, but a slip is likely.

    Nothing is said of two sites that `check_sites` doubts already.
    """
    drained, given = (values.get(f"{line}_site") for line in ("drainage", "return"))
    for prefix in ("", "second_") if not pumps_back(drained, given) else ("second_",):
        site = values.get(name := f"{prefix}drainage_site")
        if site in ARTERIAL_SITES:
            message = f"drains {PATIENT_SITES[site]}: drainage cannulae lie in a vein or in the heart"
            remarks.warning(f"{key}.{name}", message, shown(site), shown("ra"))
        site = values.get(name := f"{prefix}return_site")
        if site in _NOT_RETURNED_TO:
            message = (
                f"returns to {PATIENT_SITES[site]}: blood is usually returned to an artery (V-A), to a vein "
                "or the right atrium (V-V), or to the pulmonary artery"
            )
            remarks.warning(f"{key}.{name}", message, shown(site), shown("ra") if site == "la" else "")
    kind = CANNULAE.get(values.get("return_cannula", ""))
    if given in ARTERIAL_SITES and kind is not None and kind.key != "arterial":
        message = f"a {kind.name} cannula in {PATIENT_SITES[given]}: arterial ones return to arteries"
        remarks.warning(f"{key}.return_cannula", message, shown(kind.key), shown("arterial"))


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


# --- second cannulae ------------------------------------------------------------------------------


LINES = {"drainage": "ecmodrain", "return": "ecmoreturn"}
CONNECTIONS = {f"{node}2": f"second {line} cannula" for line, node in LINES.items()}
MARKS = {name: Mark("cannula", words) for name, words in CONNECTIONS.items()}
NOMINAL = {"ecmo.second_drainage_fr": 19.0, "ecmo.second_return_fr": 15.0, "ecmo.second_return_clamp": 0.0}
SECOND_SITES = tuple(f"second_{line}_site" for line in LINES)
NO_SITE = ""
"""Choice shown on the page if there is no second cannula; never in a case file."""
BACKWARD_L_MIN = -0.01
"""Mean flow [L/min] below which a cannula counts as flowing backwards; a closed one may leak this much."""


OUTPUTS = tuple(
    mean_flow(f"{which}_{line}_flow", f"flow through the {which} {line} cannula", signal, beside=beside)
    for line, node in LINES.items()
    for which, signal, beside in (("first", f"Q{node}", f"Q{node}2"), ("second", f"Q{node}2", ""))
)
LIMITS = tuple(
    Limit(
        one.name, "alarm", "below", BACKWARD_L_MIN,
        "blood runs backwards through this cannula: narrow the other one (its clamp) or turn the pump up",
        "physics",
    )
    for one in OUTPUTS
)  # fmt: skip


class SecondCannulae(Section):
    """Keys of second cannulae, all optional."""

    second_drainage_site: Annotated[
        str | None, patient_site("Compartment that is drained too", required=False)
    ] = None
    second_drainage_fr: Annotated[
        float | None, number("Size of second drainage cannula", "Fr", 15, 29, 19, required=False)
    ] = None
    second_return_site: Annotated[
        str | None, patient_site("Compartment that receives too", required=False)
    ] = None
    second_return_fr: Annotated[
        float | None, number("Size of second return cannula", "Fr", 15, 29, 15, required=False)
    ] = None
    second_return_clamp: Annotated[
        float, number("Clamp on the second return: 0 open, 1 closed", "", 0, 1, 0.5, required=False)
    ] = 0.0

    @model_serializer(mode="wrap")
    def _without_absent_clamp(self, serialized: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the open clamp of a second return cannula that is not there."""
        written = serialized(self)
        if self.second_return_site is None and self.second_return_clamp == 0.0:
            written.pop("second_return_clamp", None)
        return written

    def second_values(self) -> dict[str, float]:
        """Sizes and clamp of the second cannulae."""
        values = {name: getattr(self, name.removeprefix("ecmo.")) for name in NOMINAL}
        return {name: value for name, value in values.items() if value is not None}

    def second_connections(self) -> tuple[Connection, ...]:
        """Connections of the second cannulae to the ECMO circuit."""
        from eclsim.circuit.network import Connection
        from eclsim.components import Cannula

        result = []
        for line, node in LINES.items():
            site, size = getattr(self, f"second_{line}_site"), getattr(self, f"second_{line}_fr")
            if site is None or size is None:
                continue
            clamp = "ecmo.second_return_clamp" if line == "return" else 0.0
            law = Cannula(f"ecmo.second_{line}_fr", _type(line, size).coefficients, clamp)
            ends = (site, node) if line == "drainage" else (node, site)
            result.append(Connection(f"{node}2", law, *ends, "ecmo"))
        return tuple(result)


def _type(line: str, size: float) -> CannulaType:
    """Type of a cannula by its size: venous for larger sizes, arterial for smaller ones."""
    venous, arterial = CANNULAE["venous"], CANNULAE["arterial"]
    smallest = venous.sizes_fr[0] if line == "drainage" else arterial.sizes_fr[-1] + 0.01
    return venous if size >= smallest else arterial


def check_second(key: str, values: Raw, remarks: Remarks) -> None:
    """Check that sites and sizes are given together, that sites differ from the first ones, and sizes."""
    for line in LINES:
        site, size = values.get(f"second_{line}_site"), values.get(f"second_{line}_fr")
        for present, missing in (("site", "fr"), ("fr", "site")):
            present_key, other = f"second_{line}_{present}", f"second_{line}_{missing}"
            lacks = values.get(present_key) is not None and values.get(other) is None
            if lacks and f"{key}.{other}" not in remarks.refused():
                remarks.error(f"{key}.{other}", f"missing, although {present_key} is given")
        if site is not None and site in (values.get("drainage_site"), values.get("return_site")):
            message = "a site of the first cannulae"
            remarks.error(f"{key}.second_{line}_site", message, f'"{site}"', "another compartment")
        if size is not None:
            check_cannula(f"{key}.second_{line}_fr", size, _type(line, size), remarks)


def second_controls(section: SecondCannulae, used: Collection[str]) -> list[Control]:
    """Controls of sites, sizes and clamp of second cannulae; `used` are the sites of the first ones."""
    free = [site for site in PATIENT_SITES if site not in used]
    sizes = [size for name in ("venous", "arterial") for size in CANNULAE[name].sizes_fr]
    result: list[Control] = []
    for line, label in (("drainage", "Also drained from"), ("return", "Also returned to")):
        key = f"second_{line}_site"
        result.append(picker(key, label, (NO_SITE, *free), {**PATIENT_SITES, NO_SITE: "none"}))
        if getattr(section, key) is None:
            continue
        label = f"Second {line} cannula"
        result.append(Knob(f"second_{line}_fr", label, "Fr", min(sizes), max(sizes), 1))
        if line == "return":
            result.append(Knob("second_return_clamp", "Clamp on the second return", "", 0.0, 1.0, 0.01))
    return result


def with_second(raw: dict[str, Any], key: str, site: str) -> dict[str, Any]:
    """The section with a second cannula at a site (of a usual size by default), or without one."""
    line = key.removesuffix("_site")
    if site == NO_SITE:
        return {name: value for name, value in raw.items() if not name.startswith(line)}
    return {f"{line}_fr": NOMINAL[f"ecmo.{line}_fr"], **raw, key: site}
