"""Nearest right spellings of a misspelt name."""

from __future__ import annotations

from collections.abc import Iterable

# Candidates that are this much less like the word than the best one are not worth naming.
_SPREAD = 0.12
_MOST = 3


def nearest(word: str, candidates: Iterable[str]) -> tuple[str, ...]:
    """The candidates most like a word, best first; upper and lower case are not told apart.

    A word that is the beginning of a longer name ("age" of "age_years") means that name.

    Args:
        word: What was written.
        candidates: The right spellings.

    Returns:
        An empty tuple where nothing is near.
    """
    from difflib import SequenceMatcher, get_close_matches

    by_lower_case: dict[str, str] = {}
    for candidate in candidates:
        by_lower_case.setdefault(candidate.lower(), candidate)
    written = word.strip().lower()[:80]
    if written in by_lower_case:
        return (by_lower_case[written],)
    begun = [name for name in by_lower_case if written and name.startswith(f"{written}_")]
    if begun:
        return tuple(by_lower_case[name] for name in begun[:_MOST])
    result = get_close_matches(written, by_lower_case, n=_MOST, cutoff=0.6)
    likeness = {name: SequenceMatcher(None, written, name).ratio() for name in result}
    return tuple(by_lower_case[name] for name in result if likeness[name] > likeness[result[0]] - _SPREAD)


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """The nearest spellings as one phrase ("Rmc or Rpmc"); empty where nothing is near."""
    return " or ".join(nearest(word, candidates))


def spelling_hint(word: str, candidates: Iterable[str]) -> str:
    """End of a message about a misspelt name, "; did you mean Rmc or Rpmc?"; empty where nothing is near."""
    phrase = did_you_mean(word, candidates)
    return f"; did you mean {phrase}?" if phrase else ""
