"""The compiled circuit of a case: CRRT lines at ECMO sit on switches, so that moving one is data."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from eclsim.cases.resolve import resolve_parameters
from eclsim.circuit import Choice, Circuit
from eclsim.devices.crrt import crrt
from eclsim.devices.ecmo import POSITIONS, ecmo
from eclsim.devices.lvad import lvad
from eclsim.patient.circulation import circulation

if TYPE_CHECKING:
    from eclsim.cases.case import Case

ACCESS, RETURN = "crrt.access_site", "crrt.return_site"
NODES = tuple(POSITIONS.values())


def page_circuit(case: Case) -> tuple[Circuit, dict[str, float]]:
    """Circuit and values of a case.

    Where both CRRT lines are at positions of the ECMO circuit they are chosen by a value; else they are
    fixed, and moving one compiles another circuit.
    """
    values = resolve_parameters(case)
    sites: tuple[str, str] | None = None
    switched = False
    if case.crrt is not None:
        sites = (case.crrt.access_site, case.crrt.return_site)
        switched = case.ecmo is not None and all(site in POSITIONS for site in sites)
        if switched:
            values |= {
                k: float(NODES.index(POSITIONS[s])) for k, s in zip((ACCESS, RETURN), sites, strict=True)
            }
    drawn = None if case.ecmo is None else _ecmo_key(case.ecmo)
    assist = None if case.lvad is None else (case.lvad.inlet_site, case.lvad.outlet_site)
    return _circuit(drawn, "switched" if switched else sites, assist), values


def _ecmo_key(section: Any) -> tuple[str, str, str, str, bool]:
    return (
        section.drainage_site, section.return_site, section.drainage_cannula, section.return_cannula,
        not isinstance(section.pump, str),
    )  # fmt: skip


@lru_cache(maxsize=256)
def _circuit(drawn: Any, lines: Any, assist: Any) -> Circuit:
    """One object for each circuit, so that its compiled programs are found again."""
    circuit = circulation()
    if drawn is not None:
        circuit += ecmo(*drawn)
    if lines is not None and lines != "switched":
        circuit += crrt(*(POSITIONS.get(site, site) for site in lines))
    if assist is not None:
        circuit += lvad(*assist)
    if lines == "switched":  # last, as in the CRRT study, so that both share one compiled circuit
        circuit += crrt(Choice(NODES, ACCESS), Choice(NODES, RETURN))
    return circuit
