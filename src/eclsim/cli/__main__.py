"""`python -m eclsim.cli` does what `eclsim` does."""

from eclsim.cli import main

main()
