"""The CRRT circuit: access line, roller pump, tube, dialyzer, return line.

    access site ==tube==> crrttuin --(roller pump)--> crrttupf ==tube==> crrtfil --(dialyzer)--> crrttuout
        ==tube==> return site

Source: Thiel et al., Figure 1 and Table S-3.
"""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Compartment, Connection, Site
from eclsim.components import ElasticVessel, Resistance, RollerPump, Tube

GROUP = "crrt"


def crrt(access_site: Site, return_site: Site) -> Circuit:
    """A CRRT circuit between two sites: compartments of the ECMO circuit or of the patient."""
    names = ("crrttuin", "crrttupf", "crrtfil", "crrttuout")
    compartments = tuple(Compartment(name, ElasticVessel("C" + name), GROUP) for name in names)
    connections = (
        Connection("crrttuin", Tube("Lcrrttuin", "Dcrrttuin"), access_site, "crrttuin", GROUP),
        Connection("crrtpump", RollerPump("crrt.flow_ml_min"), "crrttuin", "crrttupf", GROUP),
        Connection("crrttupf", Tube("Lcrrttupf", "Dcrrttupf"), "crrttupf", "crrtfil", GROUP),
        Connection("crrtfil", Resistance("Rcrrtfil"), "crrtfil", "crrttuout", GROUP),
        Connection("crrttuout", Tube("Lcrrttuout", "Dcrrttuout"), "crrttuout", return_site, GROUP),
    )
    return Circuit(compartments, connections)
