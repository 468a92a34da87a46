"""Kinds: what the import knows of each kind of log, and the place of its reader.

Readers are imported when they read: help texts and documents need these rows alone.
"""

from factory.importing.formats.base import TABLES, Importer
from factory.importing.formats.slocum.caches import BINARY, CACHES

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
    takes_mapping=True,
    lacks=DRIVEN,
)
"""Tables of any vehicle, read by a mapping file that says what their columns are."""
