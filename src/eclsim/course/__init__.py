"""A course of hours above the steady beat; called, it is `eclsim.course.course.course`."""

from eclsim.front_door import make_callable

make_callable(__name__, "eclsim.course.course")
