"""What every output is, where it is measured, and what a case must contain to have it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, named_output
from eclsim.outputs.registry import PARTS, Output, all_outputs, output
from eclsim.reporting.beat_values import naming_at, place_label_of

EVERY_CASE = "every case"


@dataclass(frozen=True)
class OutputEntry:
    """An output in words.

    Args:
        key: its name in goals, options and files.
        label: full name.
        unit: unit of the number.
        definition: definition in terms of waveforms.
        place: places where it is measured, in words; empty if it belongs to no place.
        needs: parts of a case file without which a case does not have it; empty if every case has it.
    """

    key: str
    label: str
    unit: str
    definition: str
    place: str
    needs: tuple[str, ...]

    @property
    def needed(self) -> str:
        """Parts of a case file that it needs, in words."""
        return " and ".join(self.needs) or EVERY_CASE


def describe(name: str) -> OutputEntry:
    """Describe an output, also of a named instance of a device.

    Raises:
        UnknownOutputError: There is no such output; the message lists similar ones.
    """
    entry = output(name)
    return OutputEntry(
        entry.name, entry.long_name, entry.unit, entry.definition, _place(entry), tuple(_needed_parts(entry))
    )


def output_catalogue() -> dict[str, list[OutputEntry]]:
    """All outputs of the patient and of the only instance of each device, by what a case needs for them."""
    result: dict[str, list[OutputEntry]] = {EVERY_CASE: []}
    for name in all_outputs():
        entry = describe(name)
        result.setdefault(entry.needed, []).append(entry)
    return result


def _place(entry: Output) -> str:
    if entry.in_effect:
        return ""
    labels = dict.fromkeys(map(place_label_of, [entry.read_at] if entry.read_at else entry.needs))
    return ", ".join(label for label in labels if label)


def _needed_parts(entry: Output) -> Iterable[str]:
    """Sections and keys, those of devices first; no more than one section of each device."""
    read = {*entry.needs, *entry.parameters}
    instances: dict[str, Naming] = {}
    if (known := named_output(entry.name)) is not None:
        instances[known[0].key] = known[0]
    for signal in entry.needs:
        if (naming := naming_at(signal[1:])) is not None:
            instances.setdefault(naming.key, naming)
    order = list(devices())
    for naming in sorted(instances.values(), key=lambda naming: order.index(naming.device.key)):
        optional = [
            words
            for words, brings in naming.device.optional.items()
            if read & {naming.signal(brings), naming.parameter(brings)}
        ]
        yield " ".join([f"[{naming.key}]", *optional])
    for part, brings in PARTS:
        if not read.isdisjoint(brings):
            yield part
