"""Compartments of the patient that a device can be connected to, in words."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

_HEART_AND_LUNGS = {
    "ra": "right atrium",
    "rv": "right ventricle",
    "pas": "pulmonary aortic sinus",
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
"""Where a device stands in the regional patient that is connected to a vessel which is divided there: at the
right radial artery, and at the cava that has most of the veins."""
DRAINED: Mapping[str, str] = MappingProxyType({"svn": "tvc", "svc": "tsvc", "ivc": "tivc"})
"""The part of a vein next to the heart in a patient whose veins collapse, where a cannula at its site is."""

PATIENT_SITES: Mapping[str, str] = MappingProxyType(_PUBLISHED | _HEART_AND_LUNGS | _REGIONAL)
"""Names of all sites and what they are, those of the regional patient last."""
ONLY_REGIONAL = tuple(_REGIONAL)

ARTERIAL_SITES = ("ao", "sart", "arch", "descending", "upper", "lower")
VENOUS_SITES = ("svn", "ra", "svc", "ivc")
RIGHT_HEART = ("rv", "pas")
LEFT_HEART = ("pvn", "la", "lv")


def patient_sites(regional: bool = False) -> dict[str, str]:
    """Sites of the published or of the regional patient in words."""
    if not regional:
        return _PUBLISHED | _HEART_AND_LUNGS
    return {"ao": _PUBLISHED["ao"]} | _HEART_AND_LUNGS | _REGIONAL
