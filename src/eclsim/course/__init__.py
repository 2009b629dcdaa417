"""A course of hours above the steady beat; `eclsim.course(case)` computes one."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.course.course")
