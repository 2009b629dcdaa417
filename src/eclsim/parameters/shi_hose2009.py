"""Parameters of the Shi and Hose (2009) CellML circulation, after Korakianitis and Shi (2006).

A code-verification case: the published CellML model fixes every number, so two programs can be
compared digit by digit. It is not a healthy adult (its pulmonary artery mean is 40 mmHg). Its
chambers follow P = p0 + E(phase) (V - v0), E = Emin + (Emax - Emin) activation(phase), a different
law from that of Thiel et al. (2025). All values are assumed by its authors. The pulmonary
vein's resistance of 0.006 follows the CellML file; the printed paper is known to differ there.
Units: mmHg, mL, s; valve coefficients in mL/(s mmHg^1/2). Allowed are a hundredth to a hundred times
a value; shares up to 1, pressures [mmHg] and volumes [mL] up to 1000.
"""

from __future__ import annotations

from eclsim.parameters.parameter import read_parameters

PARAMETERS = read_parameters(__file__)
"""Every parameter of the set, by key (sas, sat: aortic sinus, systemic artery; pas, pat: pulmonary)."""
