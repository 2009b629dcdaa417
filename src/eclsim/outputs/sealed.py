"""Blood trapped behind valves that stay closed during the whole beat; the case does not determine how much.

Blood between closed valves stays there, whatever its volume. The beat also repeats with a little more blood
there and as much less elsewhere. It is therefore one of many, and the start of the search selects one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from eclsim.circuit.network import Circuit
from eclsim.devices.description import Output
from eclsim.orbit.rest import CLOSED_VALVE_L_MIN
from eclsim.outputs.registry import CHAMBERS, VALVES, find_output
from eclsim.patient.sites import DRAINED, ONLY_REGIONAL

_VESSELS: dict[str, str] = {
    **dict.fromkeys(("pas", "part", "pvn"), "pulmonary vessels"),
    **dict.fromkeys(("ao", "sart", "svn", *ONLY_REGIONAL, *DRAINED.values()), "systemic vessels"),
}


@dataclass(frozen=True)
class Sealed:
    """Parts of a circulation that no blood enters or leaves.

    Attributes:
        parts: compartments of each part, except the largest part, which is the rest of the circulation.
        reason: names of the valves that stay closed, in words.
        sentence: consequence for the numbers, and advice.
        concerns: outputs that are not determined by the case.
    """

    parts: tuple[tuple[str, ...], ...]
    reason: str
    sentence: str
    concerns: tuple[str, ...]


@dataclass(frozen=True)
class TrappedBlood:
    """Blood in parts that no blood enters or leaves, where earlier beats of the patient determine it.

    Attributes:
        sealed: the parts.
        volumes_ml: stressed volume of each part [mL].
    """

    sealed: Sealed
    volumes_ml: tuple[float, ...]

    @property
    def places(self) -> str:
        """The parts with their volumes, in words."""
        phrases = [
            f"{ml:.0f} mL in the {' with the '.join(_labels(part))}"
            for part, ml in zip(self.sealed.parts, self.volumes_ml, strict=True)
        ]
        return _listed(phrases)

    @property
    def sentence(self) -> str:
        """What the numbers rest on."""
        return (
            f"{self.sealed.reason}: pressures follow from the blood that had gathered there when the valves "
            f"closed ({self.places}). They are right only if the valves close completely and nothing vents "
            "these chambers"
        )


def sealed(
    outputs: Mapping[str, float], circuit: Circuit, values: Mapping[str, float] | None = None
) -> Sealed | None:
    """Parts isolated by closed valves in a beat; None if blood passes from any part to any other.

    Args:
        outputs: scalar outputs by name; a valve whose mean flow [L/min] is not among them counts as open.
        circuit: circuit with fixed sites.
        values: parameter values by name, for valves whose leak may be 0; without them these leak.
    """
    laws = {c.name: c.component for c in circuit.connections}
    shut = (name for name in closed_valves(outputs) if name in laws)
    valves = tuple(name for name in shut if laws[name].one_way and not laws[name].is_leaking(values or {}))
    parts = circuit.parts_without(valves) if valves else []
    if len(parts) < 2:
        return None
    largest = max(parts, key=len)
    parts = tuple(part for part in parts if part is not largest)
    names = _listed([VALVES[name] for name in valves])
    reason = f"no blood passes the {names} valve{'s' * (len(valves) > 1)} throughout the beat"
    beats = any(name in laws and name not in valves for name in VALVES)
    given = {f"Q{name}" for name, law in laws.items() if name in valves or law.given_flow}
    concerns = _undetermined(outputs, circuit, parts, given if beats else None)
    return Sealed(parts, reason, _sentence(parts, reason, beats), concerns)


def closed_valves(outputs: Mapping[str, float]) -> tuple[str, ...]:
    """Connections of the heart valves that carry no blood in a beat with these outputs."""
    return tuple(
        n for n, valve in VALVES.items() if outputs.get(f"{valve}_valve_flow", 1.0) < CLOSED_VALVE_L_MIN
    )


def valve_flows(circuit: Circuit) -> tuple[str, ...]:
    """Outputs that show which heart valves of a circuit carry blood."""
    known = {c.name for c in circuit.connections}
    return tuple(f"{valve}_valve_flow" for n, valve in VALVES.items() if n in known)


def _undetermined(
    outputs: Mapping[str, float],
    circuit: Circuit,
    parts: tuple[tuple[str, ...], ...],
    given: Collection[str] | None,
) -> tuple[str, ...]:
    """Outputs of trapped blood, and all pressures and volumes, since the rest has as much less blood.

    If a heart still beats in the rest, its output depends on that blood, too, and so do all flows except the
    `given` ones: those of roller pumps and zero flows through closed valves. Without such a heart, `given` is
    None. What controllers have set depends on it if they read any signal.
    """
    regulated = any(control.reads for control in circuit.controllers)
    within = {kind + name for part in parts for name in part for kind in "PV"}
    anywhere = {kind + c.name for c in circuit.compartments for kind in "PV"}
    # A number that is derived from other outputs is none itself.
    entries = {name: entry for name in outputs if (entry := find_output(name)) is not None}

    def depends(entry: Output) -> bool:
        # Of what controllers set, pressures are needed for their readings alone.
        read = [name for name in entry.needs if not (entry.in_effect and name[0] == "P")]
        level = entry.absolute or (len(read) == 1 and read[0] in anywhere)
        beats = given is not None and not set(read) <= set(given)
        return level or beats or bool(within.intersection(read)) or (entry.in_effect and regulated)

    return tuple(name for name, entry in entries.items() if depends(entry))


def _sentence(parts: tuple[tuple[str, ...], ...], reason: str, beats: bool) -> str:
    listing = _listed([" with the ".join(_labels(part)) for part in parts], "the ")
    flows = ", and of the flows through the heart that still beats" if beats else ""
    return (
        f"{reason}: how much blood {listing} hold{'s' * (len(parts) == 1)} is not determined by the case, "
        "but by where the computation started. The same is true of the volumes and pressures there and, "
        "because the rest of the circulation holds the remaining blood, of all pressures, including those of "
        "arteries and lines"
        f"{flows}: another start changes them by tens of mL and some mmHg, at worst tens of mmHg. "
        "Do not read them; raise Emaxlv or Emaxrv or lower the pump speed until the valves open"
    )


def _labels(part: tuple[str, ...]) -> list[str]:
    return list(dict.fromkeys(CHAMBERS.get(name) or _VESSELS.get(name, name) for name in part))


def _listed(labels: list[str], article: str = "") -> str:
    """Words as in a sentence: a, b and c."""
    phrases = [article + label for label in labels]
    return " and ".join([", ".join(phrases[:-1]), phrases[-1]] if len(phrases) > 1 else phrases)
