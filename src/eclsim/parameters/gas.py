"""Parameters of gas exchange: blood, metabolism, lungs and ventilator; a device has its own.

Those of the section [gas] are keys of that section in a case file; the others are set in [parameters]. The
defaults are those of an adult on protective ventilation; nothing was fitted.
"""

from __future__ import annotations

from eclsim.parameters.parameter import read_parameters

PREFIX = "gas."
LUNG_VOLUME = "gas.lung_volume_ml"
VO2_PER_DEGREE = "gas.vo2_percent_per_c"
NORMAL_C = 37.0
"""Temperature [C] to which a consumption that follows the temperature refers."""
TEMPERATURE_DOUBT_C = 1.5
"""Deviation from it above which consumption, and blood gases of an analyser at 37 C, are doubted [C]."""
PARAMETERS = read_parameters(__file__)
"""All parameters by name, including keys of case files. Bounds are wide on purpose: an interval that ends at
one shows that the measurements do not determine it."""
