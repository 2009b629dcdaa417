"""The combined ECMO and CRRT study; called, it is `eclsim.crrt_study.study.crrt_study`."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.crrt_study.study")
