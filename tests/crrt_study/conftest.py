"""The small study that tests of several rooms share."""

from small_study import hostile_study, study

__all__ = ["hostile_study", "study"]
