"""The study of CRRT connections to an ECMO circuit; `eclsim.crrt_study(case)` runs it."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.crrt_study.study")
