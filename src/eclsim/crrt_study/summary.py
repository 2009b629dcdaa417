"""What the command line shows of the CRRT study."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from eclsim.crrt_study.page import number
from eclsim.crrt_study.words import choice, kept, place
from eclsim.orbit.model import POLICY_WORDS

if TYPE_CHECKING:
    from eclsim.crrt_study.study import CrrtStudy

_WIDTH_OF_PIPES = 140
_COLUMNS = (
    ("Psart", "arterial\nmmHg", 1),
    ("Psvn", "venous\nmmHg", 1),
    ("Pcrrttuin", "access\nmmHg", 0),
    ("Pcrrttuout", "return\nmmHg", 0),
    ("Pecmodrain", "drainage\nmmHg", 0),
    ("PF", "ECMO\nL/min", 2),
    ("patient_volume_change", "blood volume\nmL", 0),
)


def show(study: CrrtStudy) -> None:
    """Show the schemes, best first, for each blood volume policy."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else _WIDTH_OF_PIPES, highlight=False)
    names = {scheme.letter: scheme.name for scheme in study.schemes}
    for policy, ranked in study.ranking.items():
        known = sum(one.known for one in ranked)
        among = "" if known == len(ranked) else f"; ranked: the {known} of {len(ranked)} whose beat was found"
        title = f"CRRT schemes at {study.case_speed:.0f} rpm, {POLICY_WORDS[policy]}{among}"
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for head in ("rank", "scheme", "access – return"):
            table.add_column(head)
        for _, head, _ in _COLUMNS:
            table.add_column(head, justify="right")
        table.add_column("limits kept\nto L/min", justify="right")
        means = study.means.sel(policy=policy, speed=study.case_speed)
        for one in ranked:
            cells = [
                number(float(means[name].sel(scheme=one.letter)), digits) for name, _, digits in _COLUMNS
            ]
            flow = kept(one.largest_flow, one.flow_at_most, one.throughout)
            table.add_row(place(one), one.letter, names[one.letter], *cells, flow)
        console.print(table)
        console.print("\n  ".join(choice(study, policy)) + "\n", markup=False)
