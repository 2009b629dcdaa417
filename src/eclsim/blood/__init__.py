"""Blood gases and acid-base balance, usable on their own: saturation, contents, pH, and their inverses.

>>> from eclsim import blood
>>> gases = blood.gases(po2=95.0, pco2=40.0, haemoglobin=10.0)
>>> print(f"{gases.saturation:.3f} {gases.ph:.2f} {gases.oxygen:.1f}")
0.972 7.40 13.3

All functions take numbers, lists or arrays of a common shape and return JAX arrays; they are differentiable.
"""

from eclsim.blood.gases import (
    LAWS,
    BloodGases,
    base_excess,
    gases,
    gases_with_contents,
    gases_with_saturation,
)

__all__ = ["LAWS", "BloodGases", "base_excess", "gases", "gases_with_contents", "gases_with_saturation"]
