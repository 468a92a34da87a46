"""Base of the formats: the class `Importer`, which describes one type of log and names its reader.

Here are also the table of importers, and functions that recognise a file's type.
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
"""[s] Limits of a store's sampling interval."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of the user that complete what the files state."""

    variation_deg: float | None = None
    """[degree] Magnetic variation, east positive; None takes the log's own."""
    cache: Path | None = None
    """Folder of cache files; only for importers with `takes_cache`."""
    mapping: Path | str | None = None
    """Meaning of the columns: a file or a shipped name; importers with `takes_mapping` only."""
    camera: Path | None = None
    """Calibration of the camera that filmed the vehicle; only for importers with `takes_camera`."""
    log: Path | None = None
    """Log of the vehicle in a video; only for importers with `takes_camera`."""
    marker_side: float = 0.15
    """[m] Black square of the markers in a video."""
    payload: tuple[PayloadSignal, ...] = ()
    """Columns that the user maps to signals of the payload."""


Reader = Callable[[Sequence[Path], ReadOptions, Tally], "list[DeploymentLog]"]
"""Function that reads files into one log for each deployment and counts its actions in the tally.

It raises `WrongFormat` for a file of another type, and `InputError` for a file that it cannot use.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Importer:
    """One type of log; help texts show all fields but `read`."""

    name: str
    """Name that the user types: `factory import NAME FILES`."""
    vehicle: str
    """Vehicle that writes these logs."""
    files: str
    """Files, in a few words for help texts and documents."""
    channels: str
    """Channels that a store gets from the files, in a few words for documents."""
    suffixes: frozenset[str]
    """File endings (lower case, with the dot) that a folder is searched for."""
    marks: frozenset[str]
    """Columns or variables that only such files have; empty only if a mapping defines them."""
    period: float
    """[s] Default sampling interval of the store: about half the usual spacing of the logs."""
    read: Reader | str
    """Reader function, or its place `module:function`, which is imported when it reads."""
    name_words: frozenset[str] = frozenset()
    """Words between the dots of a file's name that make it a log whatever its ending."""
    beside: frozenset[str] = frozenset()
    """Names of files in a folder that belong to the logs there and are read with them."""
    first_bytes: tuple[bytes, ...] = ()
    """First bytes of the vehicle's own binary files."""
    extra: str | None = None
    """Extra of this project, or `plugins/NAME`, with packages that reading may need."""
    takes_cache: bool = False
    """True if the reader uses `ReadOptions.cache`."""
    takes_mapping: bool = False
    """True if the reader uses `ReadOptions.mapping`: the column names are free."""
    takes_camera: bool = False
    """True for videos, which need `ReadOptions.camera` and `ReadOptions.log`."""
    instrument: bool = False
    """True for logs of an instrument, which may lie beside those of the vehicle that carries it."""
    held: frozenset[str] = frozenset()
    """Channels that are logged only on change: between samples the last value holds."""
    lacks: frozenset[str] = frozenset()
    """Channels that no such vehicle has: their absence is not reported."""
    samples: Mapping[str, Callable[[Path, Any], list[Path]]] | str | None = None
    """Writers of example logs by layout, the usual one first, or their place `module:name`."""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_-]*", self.name):
            raise InputError(
                f"importer name {self.name!r}: use small letters, digits, - and _, such as 'slocum'"
            )
        empty = [n for n in ("vehicle", "files", "channels", "suffixes") if not getattr(self, n)]
        empty += [] if self.marks or self.takes_mapping or self.takes_camera else ["marks"]
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
        """True if the file's name is that of such a log."""
        words = set(path.name.lower().split("."))
        return path.suffix.lower() in self.suffixes or bool(self.name_words & words)


class WrongFormat(OtherKind):
    """Error for a file of another type of log; `names` are the columns or variables in it."""

    def __init__(
        self, path: Path, names: Iterable[str], kind: str | None = None, *, why: str = ""
    ) -> None:
        self.path, self.names = path, tuple(names)
        self.kind = kind
        """Type of log that the file is, if known."""
        self.why = why
        """Reason why it is of another type, in words."""
        self.some = ", ".join(self.names[:5]) or "nothing"
        """First five names in the file, for the message."""
        super().__init__(f"{path.name} is of another format; it holds {self.some}")


@contextlib.contextmanager
def other_format(path: Path, names: Sequence[str]) -> Iterator[None]:
    """Turn `NoClock` into `WrongFormat` with the names in the file: it is of another format.

    Raises:
      WrongFormat: no time variable advances from sample to sample.
    """
    from factory.importing.sample_clock import NoClock  # deferred: help needs no numpy

    try:
        yield
    except NoClock as error:
        why = str(error).removeprefix(f"{path.name}: ")
        raise WrongFormat(path, names, why=why) from error


IMPORTERS: Registry[Importer] = seams.IMPORTERS
"""Every type of log that can be imported, by name."""

register = IMPORTERS.add
"""Function that adds an importer to `IMPORTERS`."""


def likely_kinds(names: Iterable[str]) -> list[str]:
    """Importers with a mark among the names, most marks first."""
    found = set(names)
    scores = {importer.name: len(importer.marks & found) for importer in IMPORTERS.values()}
    return sorted((name for name in scores if scores[name]), key=lambda name: -scores[name])


def kind_that_takes(
    path: Path, names: Iterable[str], *, arrays: bool, others: Sequence[str] = ()
) -> str | None:
    """Type of log that a table or netCDF file looks like, if its reader accepts the file; else
    None.

    If a reader fails for another reason, its type is still chosen where the file has a mark of it.

    Args:
      names: columns or variables of the file.
      arrays: True if the file is netCDF or HDF5.
      others: types that are skipped.
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
    """Tell whether a type's reader accepts a file; None if it fails for another reason.

    False means that the reader finds the file to be of another type.
    """
    try:
        read = imported(importer.read) if isinstance(importer.read, str) else importer.read
        return bool(read([path], ReadOptions(), Tally()))
    except OtherKind:
        return False
    except (InputError, ModuleNotFoundError):
        return None


def _start(path: Path) -> bytes:
    """First bytes of a file, unpacked if it is gzip."""
    with path.open("rb") as file:
        start = file.read(64)
    if start.startswith(b"\x1f\x8b"):
        with contextlib.suppress(EOFError, OSError, zlib.error), gzip.open(path, "rb") as packed:
            start = packed.read(64)
    return start


def kinds_by_bytes(path: Path) -> list[str]:
    """Types whose own binary files begin with the same bytes as this file, gzip or not."""
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
"""First bytes and marks of the logs that plugins of this project read."""


class NeedsPlugin(OtherKind):
    """Error for a file whose type of log needs a missing plugin; the message names the plugin."""


def check_plugin(path: Path, names: Iterable[str] = ()) -> None:
    """Refuse a file that looks like a type of log whose plugin is not installed.

    Args:
      names: columns or variables of the file.

    Raises:
      NeedsPlugin: the file looks like such a type.
    """
    start, found = _start(path), set(names)
    own = max(len(importer.marks & found) for importer in IMPORTERS.values())
    for kind, looks in LOOKS.items():
        begins = any(isinstance(one, bytes) and start.startswith(one) for one in looks)
        if kind not in IMPORTERS and (begins or len(found & set(looks)) > own):
            raise NeedsPlugin(f"{path.name} looks like {kind}, which {IMPORTERS.source(kind)}")


def sniff(path: str | Path) -> str | None:
    """Type of log that a file looks like, if its reader accepts the file; else None.

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
    check_plugin(path)  # before the file is read as a table
    arrays = holds_arrays(path)
    names = variable_names(path) if arrays else column_names(path)
    check_plugin(path, names)
    return kind_that_takes(path, names, arrays=arrays)


DBA = frozenset({".dba", ".asc"})
"""Endings of a Slocum's data as text."""

DRIVEN = frozenset({"measured_pump", "measured_shift", "measured_rotation", "measured_density"})
"""Channels that gliders have and most other vehicles lack."""

SLOCUM = Importer(
    name="slocum",
    vehicle="Slocum glider",
    files=".dbd .ebd .sbd .tbd .mbd .nbd with their .cac (beside the files, or `--cache FOLDER`); "
    "text of them (.dba .asc, as dbd2asc writes it); tables (csv, csv.gz, parquet) with the "
    "vehicle's own sensor names",
    channels="attitude, pump, battery position, rudder, CTD, fixes, track, reported current, "
    "batteries; `U_dvl_ms` as `true_speed`",
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
"""Importer of Teledyne's Slocum gliders."""

SEAGLIDER = Importer(
    name="seaglider",
    vehicle="Seaglider",
    files="basestation p*.nc; tables of samples, dives and ADCP",
    channels="attitude, bladder, battery position, CTD, fixes, reported current, batteries; an "
    "ADCP as `true_*`",
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
"""Importer of Seagliders and their basestation."""

SEAEXPLORER = Importer(
    name="seaexplorer",
    vehicle="SeaExplorer glider",
    files=".gli and .pld logs, plain or gzip, comma or semicolon",
    channels="attitude, ballast, masses, CTD, fixes, voltage; without the AD2CP's beam velocities",
    suffixes=TABLES,
    # the vehicle numbers its files: sea035.12.gli.sub.36
    name_words=frozenset({"gli", "pld1"}),
    marks=frozenset({"NavState", "BallastPos", "PLD_REALTIMECLOCK", "NAV_RESOURCE"}),
    period=5.0,
    read="factory.importing.formats.seaexplorer_reader:read_seaexplorer",
    samples="factory.samples.gliders:SEAEXPLORER",
)
"""Importer of Alseamar's SeaExplorer gliders."""

OG1 = Importer(
    name="og1",
    vehicle="any glider",
    files="OceanGliders OG1.0 netCDF, also what `factory export --to og1` writes",
    channels="attitude, pressure, actuators, CTD, payload, fixes; without values that flags 3 and "
    "4 call bad",
    suffixes=frozenset({".nc"}),
    marks=frozenset(
        {"LATITUDE_GPS", "PLATFORM_SERIAL_NUMBER", "TRAJECTORY", "PHASE", "LATITUDE", "LONGITUDE",
         "PITCH", "TIME"}
    ),
    period=5.0,
    read="factory.importing.formats.og1.og1_reader:read_og1",
    samples="factory.samples.archives:OG1",
)  # fmt: skip
"""Importer of the OceanGliders' common format."""

NGDAC = Importer(
    name="ngdac",
    vehicle="any glider",
    files="IOOS NGDAC netCDF, a profile a file, all of a deployment together; tables of the "
    "National Glider DAC's ERDDAP; time series of pyglider",
    channels="depth, CTD, track, reported current; attitude, actuators and fixes where the file "
    "has them",
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
"""Importer of profiles of the U.S. IOOS National Glider DAC, and time series of pyglider."""

SPRAY = Importer(
    name="spray",
    vehicle="Spray glider",
    files="binned netCDF of spraydata.ucsd.edu, a line or a project a file, and its OG1.0 files of "
    "profiles without times of the samples (with such times: `og1`; profiles of the National "
    "Glider DAC: `ngdac`)",
    channels="fixes, depth over time, CTD of the climb, reported current; no attitude, no "
    "actuators",
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
"""Importer of binned files of Scripps' Spray gliders."""

PD0 = Importer(
    name="pd0",
    vehicle="any vehicle with a Doppler log of RDI",
    files="PD0 files of Pathfinder, Explorer, Workhorse and others, in beam, instrument, ship or "
    "earth axes",
    channels="velocity through the water and over ground, height above the bottom, depth, attitude",
    suffixes=frozenset({".pd0", ".000", ".ens"}),
    marks=frozenset({"fixed leader", "variable leader"}),
    period=2.0,
    read="factory.importing.formats.pd0_reader:read_pd0_logs",
    first_bytes=(b"\x7f\x7f",),
    instrument=True,
    lacks=DRIVEN,
)
"""Importer of Doppler logs in RDI's own format; beside a vehicle's log: `--doppler`."""

CSV = Importer(
    name="csv",
    vehicle="any vehicle",
    files="tables with a --mapping file that names what each column is",
    channels="those that the mapping names",
    suffixes=TABLES,
    marks=frozenset(),
    period=1.0,
    read="factory.importing.formats.csv.table_reader:read_tables",
    samples="factory.samples.archives:TABLES",
    takes_mapping=True,
    lacks=DRIVEN,
)
"""Importer of tables of any vehicle, with a mapping file that gives the meaning of columns."""
