"""Suggestions of correct spellings for a misspelt name."""

from __future__ import annotations

from collections.abc import Iterable

# Candidates less similar to the word than the best one by this much are not suggested.
_SPREAD = 0.12
_MOST = 3
_OTHER_NAMES = {
    "norepinephrine": "noradrenaline", "epinephrine": "adrenaline", "argipressin": "vasopressin",
    "saline": "crystalloid_ml", "ringer": "crystalloid_ml", "rbc": "red_cells_ml", "prbc": "red_cells_ml",
    "erythrocytes": "red_cells_ml", "phenylephrine": "", "dopamine": "", "dopexamine": "", "isoprenaline": "",
    "isoproterenol": "", "terlipressin": "", "enoximone": "", "nitroglycerin": "", "plasma": "", "ffp": "",
    "hb": "haemoglobin_g_dl", "hgb": "haemoglobin_g_dl", "hct": "haematocrit",
}  # fmt: skip
"""Other names of drugs, fluids and blood counts; an empty one is not offered, whatever name looks like it."""


def nearest(word: str, candidates: Iterable[str]) -> tuple[str, ...]:
    """Return the candidates most similar to a word, best first; case is ignored.

    A word that is the beginning of a longer name ("age" of "age_years") is taken to mean that name.

    Args:
        word: The word as written.
        candidates: The correct spellings.

    Returns:
        At most three candidates; empty if none is similar.
    """
    from difflib import SequenceMatcher, get_close_matches

    by_lower_case: dict[str, str] = {}
    for candidate in candidates:
        by_lower_case.setdefault(candidate.lower(), candidate)
    written = word.strip().lower()[:80]
    if (other := _other_name(written.rpartition(".")[2].removesuffix("_ml"))) is not None:
        places = (name for name in by_lower_case.values() if other)
        return tuple(name for name in places if name == other or name.endswith(f".{other}"))
    if written in by_lower_case:
        return (by_lower_case[written],)
    begun = [name for name in by_lower_case if written and name.startswith(f"{written}_")]
    if begun:
        return tuple(by_lower_case[name] for name in begun[:_MOST])
    result = get_close_matches(written, by_lower_case, n=_MOST, cutoff=0.6)
    likeness = {name: SequenceMatcher(None, written, name).ratio() for name in result}
    return tuple(by_lower_case[name] for name in result if likeness[name] > likeness[result[0]] - _SPREAD)


def _other_name(word: str) -> str | None:
    """Return the name meant by another one or, with four letters or more, by its beginning ("norepi")."""
    begun = (name for key, name in _OTHER_NAMES.items() if len(word) >= 4 and key.startswith(word))
    return _OTHER_NAMES[word] if word in _OTHER_NAMES else next(begun, None)


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return the nearest spellings as a phrase ("Rmc or Rpmc"); empty if none is similar."""
    return " or ".join(nearest(word, candidates))


def spelling_hint(word: str, candidates: Iterable[str]) -> str:
    """End of a message about a misspelt name, "; did you mean Rmc or Rpmc?"; empty if no name is similar."""
    phrase = did_you_mean(word, candidates)
    return f"; did you mean {phrase}?" if phrase else ""
