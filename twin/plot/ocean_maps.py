"""Ocean maps: the colour map of each quantity, cmocean's where the water is shown.

Thyng et al. 2016, "True colors of oceanography", Oceanography 29(3).
"""

from __future__ import annotations

import warnings

from matplotlib.colors import Colormap

OCEAN_MAPS = {
    "temperature": "thermal",
    "salinity": "haline",
    "density": "dense",
    "current": "speed",
    "depth": "deep",
    "vertical_velocity": "balance",
}
"""cmocean's map of each quantity; `balance` is for signed ones and belongs on symmetric limits"""
OTHER = "cividis"
"""Of what is no property of the water"""


def ocean_map(quantity: str) -> Colormap | str:
    """The colour map of a quantity of `OCEAN_MAPS`, or that of everything else."""
    if quantity not in OCEAN_MAPS:
        return OTHER
    with warnings.catch_warnings():
        # cmocean 4.0.3 hands matplotlib an argument that goes away in 3.13
        warnings.filterwarnings("ignore", "Passing 'N' to ListedColormap")
        from cmocean import cm
    found: Colormap = getattr(cm, OCEAN_MAPS[quantity])
    return found
