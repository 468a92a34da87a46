"""Kinds of sources: which files belong together, and what else comes with them."""

from factory.watching.sources.base import Source

SLOCUM = Source(
    name="slocum",
    says="folder of a dockserver: .sbd and .tbd (.dbd, .ebd, .mbd, .nbd; compressed, too) with "
    "their .cac, and the surface dialogues *.log",
    logs=("slocum",),
    parcel=r"(?:.*/)?(.+)\.[demnst][bc]d",
    beside=(".cac", ".ccc"),
    neighbours=2,
    begin="factory.importing.formats.slocum.caches:opened",
    lists="factory.importing.formats.slocum.caches:keep_lists",
    dialogues=r".+\.log",
    read_dialogues="factory.watching.sources.surface_dialogue:read_dialogues",
)
"""Teledyne's Slocum gliders."""

SEAGLIDER = Source(
    name="seaglider",
    says="folder of a base station: p*.nc, a dive each, and comm.log with every call",
    logs=("seaglider",),
    parcel=r"(?:.*/)?(p\d{7})\.nc",
    neighbours=1,
    begin="factory.importing.formats.seaglider_dive_files:begin_of",
    dialogues=r"comm(?:_\w+)?\.log",
    read_dialogues="factory.watching.sources.comm_log:read_calls",
)
"""Seagliders and their basestation."""

SEAEXPLORER = Source(
    name="seaexplorer",
    says="folder of .gli and .pld1 files, a cycle each, plain or gzip",
    logs=("seaexplorer",),
    parcel=r"(?:.*/)?(.+)\.(?:gli|pld1)\.((?:sub|raw)\.\d+)(?:\.\w+)*",
    neighbours=1,
    begin="factory.importing.formats.seaexplorer_reader:begin_of",
)
"""Alseamar's SeaExplorer gliders."""

LRAUV = Source(
    name="lrauv",
    says="folder of .mat and .nc4 logs, one for each time the vehicle began a log",
    logs=("lrauv",),
    parcel=r"(.+)\.(?:mat|nc4?)",
    joins=True,
)
"""MBARI's long-range AUVs; logs of one vehicle may have one name, each in a folder of its own."""

NETCDF = Source(
    name="netcdf",
    says="folder with a netCDF file that grows, or with a profile a file: OG1.0, NGDAC, Spray",
    logs=("og1", "ngdac", "spray"),
)
"""Files that tell a deployment all together; of one that grows only new dives are cut."""

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
    fetch="factory.watching.sources.erddap:fetch_days",
)
"""Data sets of a server."""
