"""Global sensitivity (Sobol indices) and local identifiability of the parameters of a case."""
