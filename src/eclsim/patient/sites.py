"""Compartments of the patient that a device can be connected to, in words."""

from __future__ import annotations

from types import MappingProxyType

PATIENT_SITES: MappingProxyType[str, str] = MappingProxyType(
    {
        "ao": "aorta",
        "sart": "systemic artery",
        "svn": "systemic vein",
        "ra": "right atrium",
        "rv": "right ventricle",
        "pas": "pulmonary aortic sinus",
        "part": "pulmonary artery",
        "pvn": "pulmonary vein",
        "la": "left atrium",
        "lv": "left ventricle",
    }
)
"""Names of the sites and what they are."""

ARTERIAL_SITES = ("ao", "sart")
VENOUS_SITES = ("svn", "ra")
RIGHT_HEART = ("rv", "pas")
LEFT_HEART = ("pvn", "la", "lv")
