"""Error of the outputs on grids of resolution 1, 2 and 4 against 8, in per cent.

Run `python benchmarks/grid_convergence.py CASE.toml...`.
"""

import sys

import numpy as np

from eclsim import model_of, read_case, simulate
from eclsim.outputs.registry import leading_outputs


def main(paths: list[str]) -> None:
    """Print the worst and the median error over the outputs of the contract for each case."""
    print("| case | resolution | steps | worst output | worst error % | median error % |")
    print("|---|---|---|---|---|---|")
    for path in paths:
        model = model_of(read_case(path).case)
        fine = simulate(model, resolution=8)
        names = [o.name for o in leading_outputs() if o.name in fine]
        for resolution in (1, 2, 4):
            coarse = simulate(model, resolution=resolution)
            error = np.array([abs(float(coarse[n] / fine[n]) - 1.0) * 100.0 for n in names])
            worst = int(np.argmax(error))
            row = (
                model.name,
                resolution,
                coarse.attrs["steps_per_beat"],
                names[worst],
                error[worst],
                np.median(error),
            )
            print("| {} | {} | {} | {} | {:.3f} | {:.4f} |".format(*row), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
