"""Validation: does eclsim solve the published equations, and do these describe patients and devices?

Each module makes one comparison and returns `Check`s: rows with expected and computed number, error and
verdict. `suite` runs them for `eclsim validate`; `timing` measures speed for `eclsim benchmark`;
`demonstration` is `eclsim demo`.
The reference data and their sources are in `data/`.
"""
