"""Does eclsim solve the published equations, and do the equations describe patients and devices?

Each module holds one comparison and gives `Check`s: rows of expected, got, error and verdict. `suite` runs
them for `eclsim validate`; `timing` measures speed for `eclsim benchmark`; `demonstration` is `eclsim demo`.
The data compared with are in `data/`, with their sources.
"""
