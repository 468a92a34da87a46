"""Nearest: the name that was probably meant, by its spelling or because it means the same.

Options and arguments have one word for one thing. `SAME_MEANING` has the words that other commands,
other libraries and other people have for it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SAME_MEANING = (
    ("duration hours seconds end", "time length minutes days t_end"),
    ("mission plan", "schedule route path waypoints"),
    ("missions mission", "rows profiles dives episodes"),
    ("vehicle", "glider model xml mjcf robot platform"),
    ("current", "currents flow ocean"),
    ("density", "water stratification ctd"),
    ("floor", "bathymetry bottom seabed terrain"),
    ("start from", "position origin at lat lon latitude longitude"),
    ("latitude", "lat"),
    ("longitude", "lon lng long"),
    ("sensors", "noise suite devices"),
    ("timestep", "dt step time_step"),
    ("sample_period period", "rate sampling frequency hz"),
    ("seed seeds", "random_state random_seed rng"),
    ("workers threads", "jobs n_jobs processes cpus num_workers parallel j"),
    ("out folder", "output file o save to dest destination filename outfile"),
    ("overwrite", "force replace f clobber"),
    ("changes set", "overrides parameters"),
    ("plot plots figure page html", "figures picture png image"),
    ("store stores logs", "data dataset input zarr"),
    ("run_folder runs", "run checkpoint weights"),
    ("network", "model kind architecture net"),
    ("hidden", "units width neurons hidden_size"),
    ("layers", "depth num_layers"),
    ("optimiser", "optimizer"),
    ("colour", "color"),
    ("centred", "centered"),
    ("seconds epochs", "iterations steps budget"),
    ("goto", "waypoint target to destination"),
    ("members", "ensemble samples"),
    ("num_envs", "envs number n_envs n number_of_envs"),
    ("navigate", "navigation navigator estimator"),
)
"""Names that we have for a thing, the likelier first, and other words for it"""

CLOSE = 0.6
"""Likeness of two spellings of which one may be meant by the other; 1 is equal"""
ALMOST_EQUAL = 0.8
"""Likeness that outweighs a word of the same meaning"""


def nearest(name: str, names: Iterable[str], *, close: float = CLOSE) -> str | None:
    """The one of `names` that `name` was probably meant to be; None where none is like it."""
    known = {_plain(one): one for one in sorted(names, reverse=True)}
    given = _plain(name)
    if near := difflib.get_close_matches(given, known, n=1, cutoff=ALMOST_EQUAL):
        return known[near[0]]
    for ours, others in SAME_MEANING:
        words = ours.split()
        if given in (*words, *others.split()):
            for word in words:
                if word in known:
                    return known[word]
    near = difflib.get_close_matches(given, known, n=1, cutoff=close)
    part = [one for one in known if given and f"_{given}_" in f"_{one.replace('.', '_')}_"]
    found = [*near, *sorted(part, key=len)]
    return known[found[0]] if found else None


def _plain(name: str) -> str:
    """As options and arguments are compared: `--Sample-Period` is `sample_period`."""
    return str(name).lower().replace("-", "_").strip("_")
