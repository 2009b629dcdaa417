"""Global sensitivity (Sobol) and identifiability; `eclsim.sensitivity(case)` computes the indices."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.sensitivity.analysis")
