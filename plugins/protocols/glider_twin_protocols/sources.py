"""Sources: from where `twin watch` takes the logs of this plugin's vehicles."""

from factory.watching import Source

LRAUV = Source(
    name="lrauv",
    says="folder of .mat and .nc4 logs, one for each time the vehicle began a log",
    logs=("lrauv",),
    joins=True,
)
"""MBARI's long-range AUVs; logs of one vehicle may have one name, each in a folder of its own."""
