"""Solvers: the semi-implicit beat, its steady orbit, derivatives, and the independent adaptive path.

The front door is `steady_beats` (module `steady`); `model` says what is solved, `status` how it ended.
"""
