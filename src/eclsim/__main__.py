"""`python -m eclsim` does what `eclsim` does."""

from eclsim.cli import main

main()
