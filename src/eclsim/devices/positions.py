"""Where a CRRT line can attach to the ECMO circuit, and the paper's nine ways of doing it."""

from __future__ import annotations

from types import MappingProxyType

ECMO_POSITIONS: MappingProxyType[str, str] = MappingProxyType(
    {
        "post_dc": "ecmodrain",
        "pre_pump": "ecmotudp",
        "post_pump": "ecmotupo",
        "pre_oxy": "ecmooxy",
        "post_oxy": "ecmotuor",
        "pre_rc": "ecmoreturn",
    }
)
"""Positions in the ECMO circuit, in flow direction, and the compartment that stands there."""

CRRT_SCHEMES: MappingProxyType[str, tuple[str, str]] = MappingProxyType(
    {
        "a": ("post_pump", "pre_oxy"),
        "b": ("pre_oxy", "pre_pump"),
        "c": ("post_oxy", "pre_pump"),
        "d": ("post_oxy", "pre_rc"),
        "e": ("pre_oxy", "pre_rc"),
        "f": ("pre_oxy", "post_oxy"),
        "g": ("post_oxy", "pre_oxy"),
        "h": ("pre_pump", "post_dc"),
        "i": ("post_pump", "pre_pump"),
    }
)
"""Access and return position of each scheme, as Figure 2 of Thiel et al. 2025 draws it."""
