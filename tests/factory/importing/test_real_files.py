"""Real logs, which are no part of a checkout: what their published tables and the vehicles say."""

import numpy as np
import pytest
from logs import SHARED, refused, why

from factory.exporting.og1.deployments import export_og1_logs
from factory.importing import import_logs
from factory.soundness import verify_logs
from twin.records.logged import LogStore
from twin.records.store import write_store

pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="needs the shared real logs")
for package in ("dbdreader", "pyarrow"):
    pytest.importorskip(package)

COMET, UNIT334 = SHARED / "slocum_comet_dvl_2016", SHARED / "slocum_unit334_2023"
EXPLORER, SHORE = SHARED / "seaexplorer_pyglider", SHARED / "lrauv_shore_2013"
ONBOARD, SAILFISH = SHARED / "lrauv_onboard_sim_2021", SHARED / "auv_sailfish"
AD2CP, STATION = SHARED / "seaglider_apl_ad2cp", SHARED / "seaglider_apl_basestation3"
SG171 = [AD2CP / f"sg171_ekamsat_2024_{part}" for part in
         ("samples.parquet", "dives.csv", "ad2cp_inv.parquet")]  # fmt: skip


@pytest.fixture(scope="module")
def unit334():
    return import_logs("slocum", [UNIT334])


@pytest.fixture(scope="module")
def comet():
    return import_logs("slocum", [COMET])


@pytest.fixture(scope="module")
def sg171():
    return import_logs("seaglider", SG171)


def seconds(dataset):
    """Start times as stored, unix seconds."""
    return dataset["start_time"].values.astype(float)


def test_unit334_has_the_published_segments(unit334):
    dataset, report = unit334
    table = np.genfromtxt(UNIT334 / "unit334_segments.csv", delimiter=",", names=True)
    assert report.rows == report.rows_with_fixes == len(table) == 24
    assert seconds(dataset) == pytest.approx(table["t_start"], abs=0.01)
    assert dataset["dive_duration"].values == pytest.approx(table["duration_s"], abs=0.01)
    # the table was made on a sphere: up to 0.4 % apart
    for axis in ("north", "east"):
        ours, theirs = dataset[f"displacement_{axis}"].values, table[f"og_{axis}_m"]
        assert np.allclose(ours, theirs, rtol=5e-3, atol=0.5)
        dac = dataset[f"vehicle_dac_{axis}"].values
        assert np.allclose(dac, table[f"onboard_dac_{axis}"], atol=1e-4)


def test_unit334_flies_as_gliders_do(unit334):
    dataset, _ = unit334
    rate = np.gradient(dataset["measured_depth"].values, 2.0, axis=1)
    deep = dataset["measured_depth"].values > 10.0
    light = dataset["measured_pump"].values > 100.0
    heavy = dataset["measured_pump"].values < -100.0
    assert np.median(rate[deep & light]) < -0.1
    assert np.median(rate[deep & heavy]) > 0.1
    pitch = dataset["measured_pitch"].values
    assert np.median(pitch[deep & light]) > 20.0
    assert np.median(pitch[deep & heavy]) < -20.0
    phase = dataset["measured_phase"].values
    assert np.mean(phase[deep & heavy & (rate > 0.05)] == 1.0) > 0.99
    # with the rudder's sign, + turns to starboard
    heading = np.unwrap(np.radians(np.nan_to_num(dataset["measured_heading"].values)), axis=1)
    turn = np.gradient(heading, 2.0, axis=1)
    use = deep & (np.abs(turn) < 0.1) & np.isfinite(dataset["measured_fin"].values)
    assert np.corrcoef(turn[use], dataset["measured_fin"].values[use])[0, 1] > 0.3


def test_true_heading_brings_the_track_nearest_to_the_displacement(unit334):
    """Turning the headings by any angle makes the dead reckoning worse: the sign is right."""
    dataset, _ = unit334
    variation = float(dataset["magnetic_variation"][0])
    rate = np.gradient(dataset["measured_depth"].values, 2.0, axis=1)
    pitch = np.radians(dataset["measured_pitch"].values)
    speed = np.where(np.abs(pitch) > 0.15, np.clip(-rate / np.tan(pitch), 0.0, 0.6), 0.0)
    heading = np.radians(dataset["measured_heading"].values)
    moved = dataset["displacement_north"].values + 1j * dataset["displacement_east"].values
    misses = {}
    for name, turn in (("true", 0.0), ("magnetic", -variation), ("wrong sign", -2 * variation)):
        track = np.nansum(speed * np.exp(1j * (heading + np.radians(turn))), axis=1) * 2.0
        misses[name] = np.median(np.abs(moved - track))
    assert misses["true"] < 0.75 * misses["magnetic"] < misses["wrong sign"]


def test_every_finite_truth_sample_of_comet_lies_in_a_row(comet):
    _, report = comet
    assert report.count("read", "U_dvl_ms") == 2504
    assert report.count("left out", "true_speed") == 0
    assert "true_speed" in report.channels


def test_binary_files_agree_with_the_tables(comet, tmp_path):
    table, _ = comet
    binary, report = import_logs("slocum", [COMET / "raw"])
    assert report.deployments == ("comet",)
    assert seconds(binary) == pytest.approx(seconds(table), abs=0.01)
    for name in ("measured_pitch", "measured_depth", "measured_pump", "measured_heading"):
        apart = np.abs(binary[name].values - table[name].values)
        assert np.nanmedian(apart) < 1e-3, name
    cut = tmp_path / "comet-2016-174-05-001.dbd"
    whole = (COMET / "raw" / cut.name).read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    _, report = import_logs("slocum", [cut], cache=COMET / "raw")
    assert [e.subject for e in report.entries if "truncated" in e.detail] == [cut.name]
    refused(r"cache file \w+\.cac is missing", "slocum", [cut], cache=UNIT334 / "raw")


def test_unit334_ends_at_the_surface_in_the_vehicles_current(unit334):
    dataset, _ = unit334
    last = dataset["n_samples"].values - 1
    rows = np.arange(len(last))
    assert np.abs(dataset["measured_depth"].values[rows, last]).max() < 0.5
    assert (dataset["measured_phase"].values[rows, last] == 0.0).all()
    apart = [dataset[f"dac_{a}"].values - dataset[f"vehicle_dac_{a}"].values for a in
             ("north", "east")]  # fmt: skip
    assert np.hypot(*apart).max() < 0.015
    by_hand = {0: (-0.025, 0.019), 3: (-0.007, -0.015), 10: (0.076, 0.008)}
    for row, (north, east) in by_hand.items():
        assert float(dataset["dac_north"][row]) == pytest.approx(north, abs=0.005)
        assert float(dataset["dac_east"][row]) == pytest.approx(east, abs=0.005)


def test_comets_racing_receiver_is_dropped(comet):
    dataset, report = comet
    assert why(report, "removed", "constant velocity") == 6
    assert report.rows == 16
    # it lay in a current of 0.2 m/s and dived for ten minutes
    assert np.hypot(dataset["displacement_north"], dataset["displacement_east"]).values[0] < 130.0
    assert float(dataset["measured_depth"][0, 0]) < 1.5
    drift = np.hypot(dataset["surface_drift_north"].values, dataset["surface_drift_east"].values)
    assert np.nanmax(drift) < 1.0


def test_real_seaexplorers_float_at_their_own_zero():
    for name, rows in (("sea046_M45", 5), ("sea035_M10", 61)):
        dataset, report = import_logs("seaexplorer", [EXPLORER / f"{name}_gli.csv.gz"])
        assert why(report, "repaired", "depth offset") > 0
        assert report.rows == rows
        depth = dataset["measured_depth"].values
        at_fix = np.isfinite(dataset["measured_gps_north"].values)
        assert np.abs(depth[at_fix]).max() < 1.0
        assert (dataset["measured_phase"].values[at_fix] == 0.0).all()


def test_seaexplorer_dives_of_four_vehicles():
    dataset, report = import_logs("seaexplorer", [EXPLORER])
    assert report.deployments == ("SEA035_M10", "SEA035_M12", "SEA046_M45", "SEA063_M22")
    assert report.count("left out", "AD2CP") > 300
    # SEA063 never transmits in this piece: no fix, and no invented one
    names = dataset["deployment"].values
    assert np.isnan(dataset["displacement_north"].values[names == "SEA063_M22"]).all()
    known = np.isfinite(dataset["displacement_north"].values[names != "SEA063_M22"])
    assert (~known).sum() <= 3  # a log begins or ends in the middle of a dive
    assert known.sum() >= 75
    depth, phase = dataset["measured_depth"].values, dataset["measured_phase"].values
    deep = depth > 20.0
    pump, pitch = dataset["measured_pump"].values, dataset["measured_pitch"].values
    for wanted, sign in ((1.0, -1.0), (2.0, 1.0)):
        there = deep & (phase == wanted)
        assert sign * np.nanmedian(pump[there]) > 0.0
        assert sign * np.nanmedian(pitch[there]) > 10.0
    rotation, roll = dataset["measured_rotation"].values, dataset["measured_roll"].values
    use = deep & np.isfinite(rotation) & np.isfinite(roll)
    assert np.corrcoef(rotation[use], roll[use])[0, 1] < -0.5


@pytest.mark.parametrize(
    ("log", "kind"),
    [("slocum_unit334_2023", "slocum"), ("seaglider_apl_basestation3", "seaglider")],
)
def test_real_logs_come_back_from_their_og1_files(tmp_path, log, kind):
    """Fixes just below the surface, and silent logs around them, make the same rows again."""
    dataset, report = import_logs(kind, [SHARED / log])
    store = write_store(dataset, tmp_path / "a.zarr")
    files = export_og1_logs(LogStore(store), range(report.rows), tmp_path / "og1")
    back, again = import_logs("og1", list(files), period=report.period)
    assert again.rows == report.rows
    assert again.count("suspect") == again.count("removed", "GPS fixes") == 0
    moved = [np.sort(d["displacement_north"].values) for d in (dataset, back)]
    assert np.allclose(*moved, atol=1.0)


def test_lrauv_shore_logs_and_simulator():
    dataset, report = import_logs("lrauv", [SHORE])
    assert report.rows == 24
    assert report.rows_with_fixes == 23
    assert report.count("repeated", "depth") == 942
    assert report.count("removed", "depth") == 0
    assert float(np.nanmax(dataset["measured_depth"])) == pytest.approx(78.0, abs=1.0)
    # propelled at about 1 m/s
    speed = np.hypot(dataset["displacement_north"], dataset["displacement_east"])
    assert 0.5 < float((speed / dataset["dive_duration"]).max()) < 1.3
    dataset, report = import_logs("lrauv", [ONBOARD])
    turned = []  # a positive elevator pitches the nose down
    for row in np.flatnonzero(dataset["thruster_fraction"] > 0.9):
        one = dataset.isel(mission=row, time=slice(0, int(dataset["n_samples"][row])))
        pitching, elevator = np.gradient(one["measured_pitch"]), one["measured_elevator"].values
        known = np.isfinite(pitching + elevator) & (one["measured_depth"].values > 1.0)
        turned.append(np.corrcoef(pitching[known], elevator[known])[0, 1])
    assert len(turned) > 5
    assert max(turned) < -0.1
    assert report.rows == 15
    assert report.rows_with_fixes == 0


def test_raw_dive_100_agrees_with_its_table(sg171):
    table, _ = sg171
    raw, report = import_logs("seaglider", [AD2CP / "raw" / "p1710100.nc"])
    assert report.deployments == ("SG171",)
    assert raw["dive"].values.tolist() == [100]
    n = int(raw["n_samples"][0])
    assert n == int(table["n_samples"][0])
    limits = {
        "measured_pitch": 1e-3, "measured_roll": 1e-3, "measured_heading": 1e-3,
        "measured_pump": 1e-2, "measured_depth": 1e-3, "measured_shift": 1e-6,
        "true_surge": 1e-3, "true_sway": 1e-3, "true_heave": 1e-3, "commanded_pump": 1e-2,
        "measured_density": 0.1,
    }  # fmt: skip
    for name, limit in limits.items():
        ours, theirs = raw[name].values[0], table[name].values[0, :n]
        both = np.isfinite(ours) & np.isfinite(theirs)
        assert both.sum() > 0.6 * n, name
        apart = np.abs((ours - theirs + 180.0) % 360.0 - 180.0)
        assert np.percentile(apart[both], 99.0) < limit, name
    assert float(raw["displacement_north"][0]) == float(table["displacement_north"][0])
    # only the raw file says where the roll mass is neutral
    assert "measured_rotation" in raw
    rotation, roll = raw["measured_rotation"].values[0], raw["measured_roll"].values[0]
    deep = np.isfinite(rotation) & (raw["measured_depth"].values[0] > 10.0)
    assert np.corrcoef(rotation[deep], roll[deep])[0, 1] < -0.8


def test_every_dives_displacement_agrees_with_the_basestation():
    files = [*SG171[:2], *(p for p in AD2CP.glob("sg265*"))]
    files += [p for p in STATION.iterdir() if p.suffix in (".csv", ".parquet")]
    dataset, report = import_logs("seaglider", files)
    assert report.rows == report.rows_with_fixes == 10 + 5 + 20
    found = {
        (str(name), int(dive)): (float(north), float(east))
        for name, dive, north, east in zip(
            dataset["deployment"].values,
            dataset["dive"].values,
            dataset["displacement_north"].values,
            dataset["displacement_east"].values,
            strict=True,
        )
    }
    checked = 0
    for path in files:
        if path.suffix != ".csv":
            continue
        table = np.atleast_1d(
            np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding=None)
        )
        for row in table:
            north, east = found[str(row["glider"]), int(row["dive"])]
            # the basestation's metres per degree are those of a sphere of nautical miles
            reach = 0.01 * np.hypot(north, east) + 1.0
            assert abs(north - row["GPS_north_displacement_m"]) < reach
            assert abs(east - row["GPS_east_displacement_m"]) < reach
            checked += 1
    assert checked == 35


def test_sg171_dives_nose_down_with_the_bladder_small_and_moves_along_its_nose(sg171):
    dataset, _ = sg171
    depth, phase = dataset["measured_depth"].values, dataset["measured_phase"].values
    deep = depth > 20.0
    down, up = deep & (phase == 1.0), deep & (phase == 2.0)
    pump, pitch = dataset["measured_pump"].values, dataset["measured_pitch"].values
    assert np.median(pump[down]) < -100.0 < 100.0 < np.median(pump[up])
    assert np.median(pitch[down]) < -20.0 < 15.0 < np.median(pitch[up])
    surge, sway = dataset["true_surge"].values, dataset["true_sway"].values
    there = np.isfinite(surge) & deep
    assert there.sum() > 7000
    assert np.median(surge[there]) > 0.15
    # a wrong sign of the variation or of east would put the motion beside the hull
    assert abs(np.median(sway[there])) < 0.1 * np.median(surge[there])


def test_satellite_files_of_a_real_glider_need_no_cache_file():
    """72 of the 84 refer to a list of sensors that only the other twelve have."""
    folder = SHARED / "slocum_seus_2017" / "salacia-20170710T1942"
    dataset, report = import_logs("slocum", [folder])
    assert report.deployments == ("salacia",)
    assert len(report.files) == 84
    assert not [e for e in report.entries if e.subject == "unreadable file"]
    assert np.isfinite(dataset["measured_depth"]).sum() > 5000


def test_the_sailfish_files(tmp_path):
    dataset, report = import_logs("csv", [SAILFISH], mapping="sailfish")
    assert report.rows == 12
    assert report.count("removed", "vf") == 3847  # 45 % of the first run
    assert not report.count("suspect", "measured_dvl_sway")
    assert not report.count("not read")
    assert float(np.nanmax(np.abs(dataset["measured_dvl_surge"]))) < 3.0
    write_store(dataset, tmp_path / "sail.zarr")
    with LogStore(tmp_path / "sail.zarr") as logs:
        assert verify_logs(logs).ok
        raw = np.genfromtxt(SAILFISH / "20220719_6_1.csv", delimiter=",", names=True)
        (first, *_) = logs.missions_of("20220719_6_1")
        assert logs.signal("measured_roll", first)[0] == pytest.approx(np.degrees(raw["roll"][0]))
        assert logs.signal("measured_dvl_surge", first)[0] == pytest.approx(raw["vf"][0])
        assert logs.signal("measured_dvl_sway", first)[0] == pytest.approx(raw["vl"][0])


IVER2 = sorted((SHARED / "auv_iver2_2022").glob("IverControlData-*.log"))


@pytest.mark.skipif(not IVER2, reason="needs the shared logs of an Iver2")
def test_the_iver2_files_sink_by_their_pitch_and_turn_by_their_rudder():
    """Signs of the mapping: depth rate, yaw rate and pitch rate of the logs themselves."""
    dataset, report = import_logs("csv", IVER2, mapping="iver2")
    assert report.rows == 10
    found = {name: [] for name in ("sinks", "rate", "rudder", "turn", "elevator", "nods")}
    for row in range(report.rows):
        count = int(dataset["n_samples"][row])
        signal = {n: dataset[n].values[row, :count].astype(float) for n in dataset.data_vars
                  if n.startswith("measured_")}  # fmt: skip
        pitch = np.radians(signal["measured_pitch"])
        rate = np.gradient(signal["measured_depth"], report.period)
        use = np.isfinite(signal["measured_dvl_surge"]) & (signal["measured_depth"] > 0.5)
        found["sinks"] += list((-signal["measured_dvl_surge"] * np.sin(pitch))[use])
        found["rate"] += list(np.convolve(rate, np.ones(5) / 5, "same")[use])
        runs = signal["measured_propeller"] > 30.0
        runs[-4:] = False
        at, after = np.flatnonzero(runs), np.flatnonzero(runs) + 2
        heading = np.unwrap(np.radians(signal["measured_heading"]))
        for control, angle, rates in (("rudder", heading, "turn"), ("elevator", pitch, "nods")):
            found[control] += list(signal[f"measured_{control}"][at])
            found[rates] += list(np.gradient(angle, report.period)[after])
    fitted = np.polyfit(found["sinks"], found["rate"], 1)[0]
    assert fitted == pytest.approx(1.0, abs=0.1)
    # of the parts of remus: positive to port, positive nose down
    assert np.corrcoef(found["rudder"], found["turn"])[0, 1] < -0.4
    assert np.corrcoef(found["elevator"], found["nods"])[0, 1] < -0.4
