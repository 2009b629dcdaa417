"""Second cannulae of an ECMO circuit: V-VA and V-AV return, bicaval and left atrial (LAVA) drainage.

    second drainage site --(cannula)--> ecmodrain        ecmoreturn --(cannula, clamp)--> second return site

Each joins the line of the first cannula at a Y-piece. Their types follow from their sizes: drainage cannulae
are venous from 19 Fr on, return cannulae arterial up to 23 Fr. A clamp narrows the second return to a share
of its area: its resistance grows with the inverse square of the open share.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

from eclsim.devices.description import Control, Knob, Limit, Mark, mean_flow, picker
from eclsim.devices.plausibility import check_cannula, patient_site
from eclsim.devices.products import CannulaType
from eclsim.inputs.fields import number
from eclsim.inputs.mistakes import Remarks
from eclsim.inputs.sections import Raw, Section
from eclsim.patient.sites import PATIENT_SITES

if TYPE_CHECKING:
    from eclsim.circuit.network import Connection

LINES = MappingProxyType({"drainage": "ecmodrain", "return": "ecmoreturn"})
CONNECTIONS = MappingProxyType({f"{node}2": f"second {line} cannula" for line, node in LINES.items()})
MARKS = MappingProxyType({name: Mark("cannula", words) for name, words in CONNECTIONS.items()})
NOMINAL = MappingProxyType(
    {"ecmo.second_drainage_fr": 19.0, "ecmo.second_return_fr": 15.0, "ecmo.second_return_clamp": 0.0}
)
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
        "blood runs backwards through this cannula: narrow the other one (its clamp) or raise the speed",
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

    def second_values(self) -> dict[str, float]:
        """Sizes and clamp of the second cannulae."""
        values = {name: getattr(self, name.removeprefix("ecmo.")) for name in NOMINAL}
        return {name: value for name, value in values.items() if value is not None}

    def second_connections(self, types: Mapping[str, CannulaType]) -> tuple[Connection, ...]:
        """Connections of the second cannulae to the ECMO circuit."""
        from eclsim.circuit.network import Connection
        from eclsim.components import Cannula

        result = []
        for line, node in LINES.items():
            site, size = getattr(self, f"second_{line}_site"), getattr(self, f"second_{line}_fr")
            if site is None or size is None:
                continue
            clamp = "ecmo.second_return_clamp" if line == "return" else 0.0
            law = Cannula(f"ecmo.second_{line}_fr", _type(line, size, types).coefficients, clamp)
            ends = (site, node) if line == "drainage" else (node, site)
            result.append(Connection(f"{node}2", law, *ends, "ecmo"))
        return tuple(result)


def _type(line: str, size: float, types: Mapping[str, CannulaType]) -> CannulaType:
    """Type of a cannula by its size: venous for larger sizes, arterial for smaller ones."""
    smallest = types["venous"].sizes_fr[0] if line == "drainage" else types["arterial"].sizes_fr[-1] + 0.01
    return types["venous" if size >= smallest else "arterial"]


def check_second(key: str, values: Raw, types: Mapping[str, CannulaType], remarks: Remarks) -> None:
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
            check_cannula(f"{key}.second_{line}_fr", size, _type(line, size, types), remarks)


def second_controls(
    section: SecondCannulae, used: Collection[str], types: Mapping[str, CannulaType]
) -> list[Control]:
    """Controls of sites, sizes and clamp.

    Args:
        section: current section.
        used: sites of the first cannulae.
        types: types of cannulae.
    """
    free = [site for site in PATIENT_SITES if site not in used]
    sizes = [size for name in ("venous", "arterial") for size in types[name].sizes_fr]
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
