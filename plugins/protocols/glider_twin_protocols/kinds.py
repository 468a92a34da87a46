"""Kinds: descriptions of this plugin's import and export formats.

Readers and writers are imported on first use, so help texts and documents load only this module.
"""

from factory.exporting import Exporter
from factory.importing import Importer

PLUGIN = "plugins/protocols"
"""Plugin whose installation brings the packages that readers and writers need"""

DRIVEN = frozenset({"measured_pump", "measured_shift", "measured_rotation", "measured_density"})
"""Channels of gliders that most propelled vehicles lack."""

LRAUV = Importer(
    name="lrauv",
    vehicle="long-range AUV",
    files=".mat (v7.3), .nc4, simulator csv",
    channels="depth, attitude, temperature, fixes, track, batteries, parts of `tethys` and their "
    "commands",
    suffixes=frozenset({".mat", ".nc", ".nc4", ".csv", ".gz"}),
    marks=frozenset(
        {"EpochSeconds", "platform_pitch_angle", "latitude_fix", "time_fix",
         "platform_buoyancy_position", "platform_mass_position"}
    ),
    period=2.0,
    read="glider_twin_protocols.lrauv_reader:read_lrauv",
    samples="glider_twin_protocols.auv_samples:LRAUV",
    lacks=frozenset({"measured_rotation"}),
)  # fmt: skip
"""Logs of MBARI's long-range AUVs."""

MCAP = Importer(
    name="mcap",
    vehicle="any vehicle with ROS 2",
    files="MCAP files with ROS 2 messages, also what `factory export --to mcap` writes",
    channels="attitude, rates, accelerations, depth, track, pressure, temperature, fixes, DVL; "
    "others by --mapping",
    suffixes=frozenset({".mcap"}),
    marks=frozenset(),
    first_bytes=(b"\x89MCAP0\r\n",),
    period=0.2,
    read="glider_twin_protocols.mcap_reader:read_mcap",
    samples="glider_twin_protocols.message_samples:MCAP",
    extra=PLUGIN,
    takes_mapping=True,
    lacks=DRIVEN,
)
"""ROS 2 recordings in one MCAP file."""

ROSBAG2 = Importer(
    name="rosbag2",
    vehicle="any vehicle with ROS 2",
    files="folders of rosbag2: metadata.yaml with .db3 or .mcap",
    channels="as `mcap`",
    suffixes=frozenset({".db3", ".mcap"}),
    marks=frozenset(),
    beside=frozenset({"metadata.yaml"}),
    first_bytes=(b"SQLite format 3\0", b"\x89MCAP0\r\n"),
    period=0.2,
    read="glider_twin_protocols.mcap_reader:read_rosbag2",
    samples="glider_twin_protocols.message_samples:ROSBAG2",
    extra=PLUGIN,
    takes_mapping=True,
    lacks=DRIVEN,
)
"""ROS 2 recordings as folders of rosbag2."""

ARDUSUB = Importer(
    name="ardusub",
    vehicle="vehicles with ArduSub",
    files="dataflash logs .BIN of ArduPilot",
    channels="attitude, rates, accelerations, depth, track, fixes, battery; others by --mapping",
    suffixes=frozenset({".bin"}),
    marks=frozenset(),
    first_bytes=(b"\xa3\x95\x80",),
    period=0.1,
    read="glider_twin_protocols.ardusub_reader:read_ardusub",
    samples="glider_twin_protocols.message_samples:ARDUSUB",
    extra=PLUGIN,
    takes_mapping=True,
    lacks=DRIVEN,
)
"""ArduPilot's logs of underwater vehicles."""

LSF = Importer(
    name="lsf",
    vehicle="LAUV and other vehicles with DUNE",
    files="logs .lsf and .lsf.gz of IMC, the messages of LSTS",
    channels="attitude, rates, accelerations, depth, track, DVL, propeller, fins, CTD, fixes, "
    "battery; others by --mapping",
    suffixes=frozenset({".lsf"}),
    name_words=frozenset({"lsf"}),
    marks=frozenset(),
    first_bytes=(b"\x54\xfe", b"\xfe\x54"),
    period=0.2,
    read="glider_twin_protocols.lsf_reader:read_lsf",
    samples="glider_twin_protocols.auv_samples:LSF",
    extra=PLUGIN,
    takes_mapping=True,
    lacks=DRIVEN,
)
"""Logs of the vehicles of LSTS, Porto."""

DORADO = Importer(
    name="dorado",
    vehicle="Dorado AUV",
    files="the vehicle's own .log of each instrument, netCDF of these, and products (`*_1S.nc`) by "
    "MBARI's auv-python; a folder is a mission",
    channels="attitude, rates, depth, track, fixes, propeller, CTD; fins, DVL and others by "
    "--mapping",
    suffixes=frozenset({".log", ".nc"}),
    marks=frozenset(
        {"mPhi", "mTheta", "mPsi", "mOmega_x", "propRpm", "numberOfSatellites", "dvlBotVelx",
         "navigation_roll", "navigation_pitch", "navigation_yaw"}
    ),
    first_bytes=(b"# binary ",),
    period=0.2,
    read="glider_twin_protocols.dorado_reader:read_dorado",
    samples="glider_twin_protocols.auv_samples:DORADO",
    takes_mapping=True,
    lacks=DRIVEN,
)  # fmt: skip
"""Logs of MBARI's Dorado vehicles."""

MCAP_FILES = Exporter(
    name="mcap",
    title="MCAP recordings with standard ROS 2 messages, for Foxglove and rosbag tools",
    ending="-mcap",
    write="glider_twin_protocols.mcap_file:export_mcap",
    extra=PLUGIN,
)
"""Export of missions and logs as MCAP recordings."""
