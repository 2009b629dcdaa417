"""Compartments of the patient to which a device can be connected, with labels."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

_HEART_AND_LUNGS = {
    "ra": "right atrium",
    "rv": "right ventricle",
    "pas": "pulmonary sinus",
    "part": "pulmonary artery",
    "pvn": "pulmonary vein",
    "la": "left atrium",
    "lv": "left ventricle",
}
_PUBLISHED = {"ao": "aorta", "sart": "systemic artery", "svn": "systemic vein"}
_REGIONAL = {
    "arch": "aortic arch",
    "descending": "descending aorta",
    "upper": "arteries of the upper body",
    "lower": "arteries of the lower body",
    "svc": "superior vena cava",
    "ivc": "inferior vena cava",
}
SAME_IN_REGIONS: Mapping[str, str] = MappingProxyType({"sart": "upper", "svn": "ivc"})
"""Site in the regional patient of a device connected to a vessel that is divided there: the right radial
artery, and the cava that holds most of the venous blood."""
DRAINED: Mapping[str, str] = MappingProxyType({"svn": "tvc", "svc": "tsvc", "ivc": "tivc"})
"""Collapsible part of each vein next to the heart; a cannula at the vein's site is in this part."""

PATIENT_SITES: Mapping[str, str] = MappingProxyType(_PUBLISHED | _HEART_AND_LUNGS | _REGIONAL)
"""Names and labels of all sites, those of the regional patient last."""
ONLY_REGIONAL = tuple(_REGIONAL)

ARTERIAL_SITES = ("ao", "sart", "arch", "descending", "upper", "lower")
VENOUS_SITES = ("svn", "ra", "svc", "ivc")
RIGHT_HEART = ("rv", "pas")
LEFT_HEART = ("pvn", "la", "lv")
BEFORE_LUNGS = (*VENOUS_SITES, *RIGHT_HEART, "part")
"""Sites of venous blood."""
AFTER_LUNGS = (*LEFT_HEART, *ARTERIAL_SITES)
"""Sites whose blood reaches the body's organs without passing the lungs."""


def patient_sites(regional: bool = False) -> dict[str, str]:
    """Names and labels of the sites of the published or of the regional patient."""
    if not regional:
        return _PUBLISHED | _HEART_AND_LUNGS
    return {"ao": "ascending aorta"} | _HEART_AND_LUNGS | _REGIONAL
