"""Importer: what the import must know of one kind of log, and the function that reads it.

Registry of the importers, and which kind of log a file looks like.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gzip
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from factory import seams
from factory.importing.formats.slocum.caches import BINARY, CACHES
from factory.importing.tally import OtherKind, Tally
from twin.bounded import check_regular
from twin.errors import InputError, OddFile
from twin.plugins import imported
from twin.registry import Registry

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.payload import PayloadSignal


TABLES = frozenset({".csv", ".gz", ".parquet", ".txt"})
"""Suffixes of tables, which `factory.importing.columns.read_table` reads."""
ARRAYS = frozenset({".nc", ".nc4", ".mat"})
"""Suffixes of netCDF and HDF5 files, which `factory.importing.netcdf` opens."""
SHORTEST, LONGEST = 0.05, 120.0
"""[s] Periods that a store of logs can have."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What the user says about logs that the files do not."""

    variation_deg: float | None = None
    """[degree] Magnetic variation, east positive; None takes the log's own."""
    cache: Path | None = None
    """Folder of cache files; only for importers with `takes_cache`."""
    mapping: Path | str | None = None
    """What the columns are, as a file or by a shipped name; only for importers with
    `takes_mapping`."""
    payload: tuple[PayloadSignal, ...] = ()
    """Columns that the user maps to signals of the payload."""


Reader = Callable[[Sequence[Path], ReadOptions, Tally], "list[DeploymentLog]"]
"""Reads files into one log for each deployment, counting what it does in the tally.

It raises `WrongFormat` for a file of another kind and `InputError` for one that it cannot use.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Importer:
    """One kind of log; help texts show all but `read`."""

    name: str
    """What the user types: `factory import NAME FILES`."""
    vehicle: str
    """Whose logs these are."""
    files: str
    """The files, in a few words for help texts and documents."""
    channels: str
    """What a store gets of them, in a few words for documents."""
    suffixes: frozenset[str]
    """Endings (lower case, with the dot) that a folder is searched for."""
    marks: frozenset[str]
    """Names of columns or variables that such files have and others do not; empty only where a
    mapping says what they are."""
    period: float
    """[s] Default period of the store: about half the usual spacing of the logs."""
    read: Reader | str
    """The reader, or its place `module:function`, which is imported when it reads."""
    name_words: frozenset[str] = frozenset()
    """Words between the dots of a file's name that make it a log whatever its ending."""
    beside: frozenset[str] = frozenset()
    """Names of files in a folder that belong to the logs there and are read with them."""
    first_bytes: tuple[bytes, ...] = ()
    """How the vehicle's own binary files begin."""
    extra: str | None = None
    """Extra of this project, or `plugins/NAME`, with the packages which reading may need."""
    takes_cache: bool = False
    """Whether the reader uses `ReadOptions.cache`."""
    takes_mapping: bool = False
    """Whether the reader uses `ReadOptions.mapping`: its files have names of their own choice."""
    held: frozenset[str] = frozenset()
    """Channels that the logs give only when they change: between samples the last value holds."""
    lacks: frozenset[str] = frozenset()
    """Channels that no such vehicle has: their absence is not reported."""
    samples: Mapping[str, Callable[[Path, Any], list[Path]]] | str | None = None
    """Writers of `factory.samples` by layout, the usual one first, or their place `module:name`."""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_-]*", self.name):
            raise InputError(
                f"importer name {self.name!r}: use small letters, digits, - and _, such as 'slocum'"
            )
        empty = [n for n in ("vehicle", "files", "channels", "suffixes") if not getattr(self, n)]
        empty += [] if self.marks or self.takes_mapping else ["marks"]
        wrong = sorted(s for s in self.suffixes if not s.startswith(".") or s != s.lower())
        why = ""
        if empty:
            why = f"{empty[0]} is empty; state what it is"
        elif wrong:
            why = (
                f"suffix {wrong[0]!r} must begin with a dot and be in small letters, such as '.csv'"
            )
        elif not SHORTEST <= self.period <= LONGEST:
            why = f"period must be within {SHORTEST:g} to {LONGEST:g} s, not {self.period:g}"
        elif not (callable(self.read) or (isinstance(self.read, str) and ":" in self.read)):
            why = f"read must be a function or its place `module:function`, not {self.read!r}"
        if why:
            raise InputError(f"importer {self.name!r}: {why}")

    def accepts(self, path: Path) -> bool:
        """Whether the file's name is that of such a log."""
        words = set(path.name.lower().split("."))
        return path.suffix.lower() in self.suffixes or bool(self.name_words & words)


class WrongFormat(OtherKind):
    """A file is not a log of the kind that is read; `names` are the columns or variables in it."""

    def __init__(
        self, path: Path, names: Iterable[str], kind: str | None = None, *, why: str = ""
    ) -> None:
        self.path, self.names = path, tuple(names)
        self.kind = kind
        """What it is by its first bytes"""
        self.why = why
        """What it lacks to be of the kind, in words"""
        self.some = ", ".join(self.names[:5]) or "nothing"
        """The first names"""
        super().__init__(f"{path.name} is of another format; it holds {self.some}")


@contextlib.contextmanager
def other_format(path: Path, names: Sequence[str]) -> Iterator[None]:
    """Make of a file without a clock of the samples one of another format, by the names in it.

    Raises:
      WrongFormat: no variable of time goes on from sample to sample.
    """
    from factory.importing.sample_clock import NoClock  # it needs numpy, help does not

    try:
        yield
    except NoClock as error:
        why = str(error).removeprefix(f"{path.name}: ")
        raise WrongFormat(path, names, why=why) from error


IMPORTERS: Registry[Importer] = seams.IMPORTERS
"""Every kind of log that can be imported, by name."""

register = IMPORTERS.add
"""Add an importer of one's own."""


def likely_kinds(names: Iterable[str]) -> list[str]:
    """The importers with a mark among the names, those with most marks first."""
    found = set(names)
    scores = {importer.name: len(importer.marks & found) for importer in IMPORTERS.values()}
    return sorted((name for name in scores if scores[name]), key=lambda name: -scores[name])


def kind_that_takes(
    path: Path, names: Iterable[str], *, arrays: bool, others: Sequence[str] = ()
) -> str | None:
    """The kind of log that a table or netCDF file looks like, whose reader takes it; None: no kind.

    A reader that says what else is wrong with the file takes it where the file has names that only
    its kind has.

    Args:
      names: of its columns or variables.
      arrays: whether it is netCDF or HDF5.
      others: kinds that are not asked.
    """
    likely = likely_kinds(names)
    endings = ARRAYS if arrays else TABLES
    rest = [n for n, one in IMPORTERS.items() if arrays and one.marks and n not in likely]
    for name in (*likely, *rest):
        importer = IMPORTERS[name]
        if name in others or not importer.suffixes & endings:
            continue
        taken = takes(importer, path)
        if taken or (taken is None and name in likely):
            return name
    return None


def takes(importer: Importer, path: Path) -> bool | None:
    """Whether a kind's reader takes a file; None: the file may be of the kind, but cannot be read.

    A file of which the reader says that it is of another kind is not taken.
    """
    try:
        read = imported(importer.read) if isinstance(importer.read, str) else importer.read
        return bool(read([path], ReadOptions(), Tally()))
    except OtherKind:
        return False
    except (InputError, ModuleNotFoundError):
        return None


def _start(path: Path) -> bytes:
    """First bytes of a file, or of what gzip packed into it."""
    with path.open("rb") as file:
        start = file.read(64)
    if start.startswith(b"\x1f\x8b"):
        with contextlib.suppress(EOFError, OSError, zlib.error), gzip.open(path, "rb") as packed:
            start = packed.read(64)
    return start


def kinds_by_bytes(path: Path) -> list[str]:
    """The kinds whose own binary files begin as this one does, packed by gzip or not."""
    start = _start(path)
    return [one.name for one in IMPORTERS.values() if start.startswith(one.first_bytes)]


LOOKS: dict[str, tuple[bytes | str, ...]] = {
    "mcap": (b"\x89MCAP0\r\n",),
    "rosbag2": (b"SQLite format 3\0",),
    "ardusub": (b"\xa3\x95\x80",),
    "lsf": (b"\x54\xfe", b"\xfe\x54"),
    "dorado": (b"# binary ", "mPhi", "mTheta", "mPsi", "mOmega_x", "propRpm", "numberOfSatellites",
               "dvlBotVelx", "navigation_roll", "navigation_pitch", "navigation_yaw"),
    "lrauv": ("EpochSeconds", "platform_pitch_angle", "latitude_fix", "time_fix",
              "platform_buoyancy_position", "platform_mass_position"),
}  # fmt: skip
"""First bytes and marks of the logs that plugins of this project read"""


class NeedsPlugin(OtherKind):
    """A file looks like a kind of log whose plugin is not installed; the message names it."""


def check_plugin(path: Path, names: Iterable[str] = ()) -> None:
    """Refuse a file that looks like a kind of log whose plugin is not installed.

    Args:
      names: of its columns or variables.

    Raises:
      NeedsPlugin: it does.
    """
    start, found = _start(path), set(names)
    own = max(len(importer.marks & found) for importer in IMPORTERS.values())
    for kind, looks in LOOKS.items():
        begins = any(isinstance(one, bytes) and start.startswith(one) for one in looks)
        if kind not in IMPORTERS and (begins or len(found & set(looks)) > own):
            raise NeedsPlugin(f"{path.name} looks like {kind}, which {IMPORTERS.source(kind)}")


def sniff(path: str | Path) -> str | None:
    """The kind of log that a file looks like, whose reader takes it; None when it looks like none.

    Raises:
      InputError: the file cannot be read, or its plugin is not installed.
    """
    from factory.importing.columns import column_names
    from factory.importing.netcdf import holds_arrays, variable_names

    path = Path(path)
    try:
        check_regular(path)
    except OddFile as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    begins = kinds_by_bytes(path)
    if begins:
        return begins[0]
    check_plugin(path)  # before it is read as a table
    arrays = holds_arrays(path)
    names = variable_names(path) if arrays else column_names(path)
    check_plugin(path, names)
    return kind_that_takes(path, names, arrays=arrays)


DBA = frozenset({".dba", ".asc"})
"""Endings of a Slocum's data as text"""

DRIVEN = frozenset({"measured_pump", "measured_shift", "measured_rotation", "measured_density"})
"""What gliders have and most other vehicles lack."""

SLOCUM = Importer(
    name="slocum",
    vehicle="Slocum glider",
    files=".dbd .ebd .sbd .tbd .mbd .nbd with their .cac (beside the files, or `--cache FOLDER`); "
    "text of them (.dba .asc, as dbd2asc writes it); tables (csv, csv.gz, parquet) with the "
    "vehicle's own sensor names",
    channels="attitude, ballast or oil volume, battery, rudder, CTD, GPS, on-board track, reported "
    "current, thruster, batteries; `U_dvl_ms` becomes `true_speed`",
    suffixes=BINARY | CACHES | DBA | TABLES,
    marks=frozenset(
        {"m_depth", "m_pressure", "m_pitch", "U_dvl_ms", "og_north_m", "sci_water_pressure",
         "m_gps_lat", "m_water_vx", "mag_var_rad"}
    ),
    first_bytes=(b"dbd_label",),
    period=2.0,
    read="factory.importing.formats.slocum:read_slocum",
    samples="factory.samples.gliders:SLOCUM",
    extra="slocum",
    takes_cache=True,
    lacks=frozenset({"measured_rotation"}),
)  # fmt: skip
"""Teledyne's Slocum gliders."""

SEAGLIDER = Importer(
    name="seaglider",
    vehicle="Seaglider",
    files="basestation p*.nc; tables of samples, dives and ADCP",
    channels="attitude, bladder, both battery axes, CTD, three fixes a dive, reported current, "
    "batteries, pump power; the ADCP's inverse solution becomes `true_surge/sway/heave` "
    "and `true_current_*`",
    suffixes=TABLES | {".nc"},
    marks=frozenset(
        {"vbd_cc", "u_ttw", "gps2_lat", "gpsE_time", "eng_pitchAng", "log_gps_lat",
         "sg_cal_id_str", "eng_vbdCC", "gc_st_secs"}
    ),
    period=5.0,
    read="factory.importing.formats.seaglider_reader:read_seaglider",
    samples="factory.samples.gliders:SEAGLIDER",
    held=frozenset({"measured_shift", "measured_rotation"}),
)  # fmt: skip
"""Seagliders and their basestation."""

SEAEXPLORER = Importer(
    name="seaexplorer",
    vehicle="SeaExplorer glider",
    files=".gli and .pld logs, plain or gzip, comma or semicolon",
    channels="attitude, ballast, both masses, declination, fixes, voltage; CTD of the payload. "
    "Beam velocities of an AD2CP are left out: without their transform and a reference layer they "
    "are no velocity through the water",
    suffixes=TABLES,
    # the vehicle numbers its files: sea035.12.gli.sub.36
    name_words=frozenset({"gli", "pld1"}),
    marks=frozenset({"NavState", "BallastPos", "PLD_REALTIMECLOCK", "NAV_RESOURCE"}),
    period=5.0,
    read="factory.importing.formats.seaexplorer_reader:read_seaexplorer",
    samples="factory.samples.gliders:SEAEXPLORER",
)
"""Alseamar's SeaExplorer gliders."""

OG1 = Importer(
    name="og1",
    vehicle="any glider",
    files="OceanGliders OG1.0 netCDF, also what `factory export --to og1` writes",
    channels="whatever of attitude, pressure, actuators, CTD, payload and fixes the file has; "
    "values that its flags call bad (3, 4) are removed",
    suffixes=frozenset({".nc"}),
    marks=frozenset(
        {"LATITUDE_GPS", "PLATFORM_SERIAL_NUMBER", "TRAJECTORY", "PHASE", "LATITUDE", "LONGITUDE",
         "PITCH", "TIME"}
    ),
    period=5.0,
    read="factory.importing.formats.og1.og1_reader:read_og1",
    samples="factory.samples.archives:OG1",
)  # fmt: skip
"""The OceanGliders' common format."""

NGDAC = Importer(
    name="ngdac",
    vehicle="any glider",
    files="IOOS NGDAC netCDF, a profile a file, all of a deployment together; tables of the "
    "National Glider DAC's ERDDAP; time series of pyglider",
    channels="depth, CTD, the file's track, reported current; attitude, actuators and fixes where "
    "the file keeps the vehicle's own sensors; the fixes that a time series' track goes through",
    suffixes=frozenset({".nc"}),
    marks=frozenset(
        {"profile_id", "profile_lat", "profile_lon", "profile_time", "lat_uv", "profile_index",
         "profile_direction", "distance_over_ground"}
    ),
    period=5.0,
    read="factory.importing.formats.ngdac_reader:read_ngdac",
    samples="factory.samples.archives:NGDAC",
    lacks=frozenset({"measured_pump", "measured_shift", "measured_rotation"}),
)  # fmt: skip
"""Profile files of the U.S. IOOS National Glider DAC, and time series of pyglider."""

SPRAY = Importer(
    name="spray",
    vehicle="Spray glider",
    files="binned netCDF of spraydata.ucsd.edu, a line or a project a file, and its OG1.0 files of "
    "profiles without times of the samples (with such times: `og1`; profiles of the National "
    "Glider DAC: `ngdac`)",
    channels="fixes and depth over time, made again of the middles of dives and profiles; CTD of "
    "the climb, reported current. Attitude and actuators are not in these files",
    suffixes=frozenset({".nc"}),
    marks=frozenset(
        {"u_depth_mean", "v_depth_mean", "trajectory_index", "mission_profile", "time_profile",
         "latitude_profile", "latitude_uv", "TIME_PROFILE", "LATITUDE_PROFILE", "LATITUDE_UV"}
    ),
    period=60.0,
    read="factory.importing.formats.spray_reader:read_spray",
    samples="factory.samples.archives:SPRAY",
    lacks=frozenset(
        {"measured_pitch", "measured_roll", "measured_heading", "measured_pump", "measured_shift",
         "measured_rotation"}
    ),
)  # fmt: skip
"""Binned files of Scripps' Spray gliders."""

CSV = Importer(
    name="csv",
    vehicle="any vehicle",
    files="tables with a --mapping file that names what each column is",
    channels="what the mapping names: attitude, body rates, accelerations, DVL, depth, CTD, fixes, "
    "track, controls by the names of their parts",
    suffixes=TABLES,
    marks=frozenset(),
    period=1.0,
    read="factory.importing.formats.csv.table_reader:read_tables",
    samples="factory.samples.archives:TABLES",
    takes_mapping=True,
    lacks=DRIVEN,
)
"""Tables of any vehicle, read by a mapping file that says what their columns are."""
