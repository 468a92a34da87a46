"""Kinds of sources: which logs come from where, and what a vehicle said at the surface."""

from glider_twin_ops.watching.sources.base import Source

SLOCUM = Source(
    name="slocum",
    says="folder of a dockserver: .sbd and .tbd (.dbd, .ebd, .mbd, .nbd; compressed, too) with "
    "their .cac, and the surface dialogues *.log",
    logs=("slocum",),
    dialogues=r".+\.log",
    read_dialogues="glider_twin_ops.watching.sources.surface_dialogue:read_dialogues",
)
"""Teledyne's Slocum gliders."""

SEAGLIDER = Source(
    name="seaglider",
    says="folder of a base station: p*.nc, a dive each, and comm.log with every call",
    logs=("seaglider",),
    dialogues=r"comm(?:_\w+)?\.log",
    read_dialogues="glider_twin_ops.watching.sources.comm_log:read_calls",
)
"""Seagliders and their basestation."""

SEAEXPLORER = Source(
    name="seaexplorer",
    says="folder of .gli and .pld1 files, a cycle each, plain or gzip",
    logs=("seaexplorer",),
)
"""Alseamar's SeaExplorer gliders."""

LRAUV = Source(
    name="lrauv",
    says="folder of .mat and .nc4 logs, one for each time the vehicle began a log",
    logs=("lrauv",),
    joins=True,
)
"""MBARI's long-range AUVs; logs of one vehicle may have one name, each in a folder of its own."""

NETCDF = Source(
    name="netcdf",
    says="folder with a netCDF file that grows, or with a profile a file: OG1.0, NGDAC, Spray",
    logs=("og1", "ngdac", "spray"),
)
"""Files of one deployment, or one that grows."""

TABLES = Source(
    name="tables",
    says="folder of tables, or of logs of a kind of your own",
    logs=("csv",),
)
"""Tables of any vehicle, by a mapping; and importers from outside the package."""

ERDDAP = Source(
    name="erddap",
    says="a tabledap data set of an ERDDAP server, https://SERVER/erddap/tabledap/DATASET, read as "
    "a table by the mapping of deployment.toml",
    logs=("csv",),
    address=r"https?://[^?#]+/tabledap/[^/?#]+/?$",
    fetch="glider_twin_ops.watching.sources.erddap:fetch_days",
)
"""Data sets of a server."""
