"""The small study that tests of several rooms share."""

from small_study import study

__all__ = ["study"]
