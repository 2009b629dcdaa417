"""Where the CRRT lines go on an ECMO circuit; `eclsim.crrt_study(case)` runs the study."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.crrt_study.study")
