"""Devices that are connected to a patient: ECMO, CRRT and LVAD, and their constants."""
