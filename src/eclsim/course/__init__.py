"""A course: hours of a case, as a sequence of steady beats; `eclsim.course(case)` computes one."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.course.course")
