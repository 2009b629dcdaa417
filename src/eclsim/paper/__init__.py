"""Recomputation of Thiel et al. 2025: printed numbers and those of eclsim side by side on one page."""
