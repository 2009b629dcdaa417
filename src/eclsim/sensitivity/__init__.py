"""Global sensitivity (Sobol) and identifiability; called, it is `eclsim.sensitivity.analysis.sensitivity`."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.sensitivity.analysis")
