"""How much of the blood that the CRRT draws has just been through it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eclsim.circuit.network import Circuit


def recirculated_fraction(circuit: Circuit, mean_flows: Mapping[str, float]) -> float | None:
    """Share of the access flow that came out of the return line without passing the patient.

    A tracer of concentration 1 leaves the return line; blood of the patient has none; every extracorporeal
    compartment mixes what flows in. Steady balance: sum(Q_in c_upstream) = c sum(Q_in).

    Args:
        circuit: with CRRT, else there is no answer (None).
        mean_flows: mean flow of each connection [mL/s]; a negative one runs backwards.
    """
    names = [c.name for c in circuit.compartments if c.group == "ecmo"]
    if not any(c.name == "crrttuin" for c in circuit.connections):
        return None
    access, giving = circuit.connection("crrttuin").source, circuit.connection("crrttuout").target
    if not isinstance(access, str) or not isinstance(giving, str):
        return None
    if access not in names:
        return 0.0
    place = {name: i for i, name in enumerate(names)}
    balance, inflow = np.zeros((len(names), len(names))), np.zeros(len(names))
    for connection in circuit.connections:
        flow = mean_flows[connection.name]
        up, down = connection.source, connection.target
        if not isinstance(up, str) or not isinstance(down, str):
            return None
        if flow < 0.0:
            up, down, flow = down, up, -flow
        if down not in place or connection.name == "crrttuin":
            continue
        balance[place[down], place[down]] += flow
        if connection.name == "crrttuout":
            inflow[place[down]] += flow
        elif up in place:
            balance[place[down], place[up]] -= flow
    return float(np.linalg.lstsq(balance, inflow, rcond=None)[0][place[access]])
