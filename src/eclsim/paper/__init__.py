"""Thiel et al. 2025 recomputed: its printed numbers and what eclsim gives, side by side on one page."""
