"""Entry point of `python -m eclsim`, equivalent to the command `eclsim`."""

from eclsim.cli import main

main()
