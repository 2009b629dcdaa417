"""How much time lies between measurements whose names are times."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from eclsim.cases.cohort_rows import when
from eclsim.cases.mistakes import CaseError, Mistake, shown

_IN_FILE_NAMES = re.compile(r"(\d{4}-\d\d-\d\d)[T_ ](\d\d)[-.]?(\d\d)")
SECONDS_PER_HOUR = 3600.0


def elapsed_hours(names: Sequence[str]) -> list[float | None] | None:
    """Hours from each measurement to the next, or None where the names do not tell.

    Args:
        names: of the measurements in their order, such as 2024-03-01T08:00, in file names 2024-03-01T08-00.

    Returns:
        None for the first, hours for every other; None instead of all where a name is no time, or where some
        have a time zone and others not.

    Raises:
        CaseError: A time before the one before it.
    """
    times = [when(_IN_FILE_NAMES.sub(r"\1T\2:\3", name)) for name in names]
    known = [t for t in times if t is not None]
    if len(known) < len(names) or len({t.tzinfo is None for t in known}) > 1:
        return None
    hours = [(later - earlier).total_seconds() / SECONDS_PER_HOUR for earlier, later in pairwise(known)]
    wrong = [
        Mistake("measurement", f"earlier than {shown(names[k])}, which comes before it", shown(names[k + 1]),
                "measurements in order of time")
        for k, passed in enumerate(hours)
        if passed < 0.0
    ]  # fmt: skip
    if wrong:
        raise CaseError(wrong)
    return [None, *hours]
