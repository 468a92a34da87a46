"""Round trip: export, import and export again give the same OG1.0 file, of logs and of flights."""

import netCDF4
import numpy as np
import pytest
from logs import stored
from simulated_logs import simulated_flight

from factory.exporting import EXPORTERS
from factory.generation.generated_store import GeneratedStore, open_exportable
from factory.importing import import_logs
from factory.importing.deployment_log import Channel
from factory.importing.formats.og1.derived import oxygen_per_volume
from factory.importing.tally import Tally
from factory.samples import Flight
from factory.samples.gliders import write_basestation, write_slocum
from twin.physics.true_signals import declare_parts
from twin.records.logged import LogStore
from twin.records.schema import Variable, declare
from twin.records.store import write_store
from twin.vehicle.vehicle import load_vehicle

FLIGHT = Flight(dives=3)
DEGREE = 1e-6
"""[degree] 0.1 m: waypoints and tracks are stored in float32 metres"""
EXCEPTIONS = {
    "LATITUDE": DEGREE, "LONGITUDE": DEGREE, "POSITION_SD": 1e-2,
    "GLIDER_SPEED_MODEL": 1e-5, "GLIDER_HORZ_VELO_MODEL": 1e-5, "GLIDER_VERT_VELO_MODEL": 1e-5,
    "GLIDER_SURGE_MODEL": 1e-5, "GLIDER_SWAY_MODEL": 1e-5, "ANGLE_OF_ATTACK_MODEL": 1e-3,
    "VERT_CURR_MODEL": 1e-5, "DAC_NORTH_MODEL": 1e-5, "DAC_EAST_MODEL": 1e-5,
    "DAC_SD_MODEL": 1e-5,  # by the flight model from the depth
    "GLIDER_SPEED_SD_MODEL": 1e-3, "ANGLE_OF_ATTACK_SD_MODEL": 0.1,  # differences over ERROR_STEP
    "DAC_NORTH": 1e-6, "DAC_EAST": 1e-6,  # by the import from the depth
    "DEPTH": 1e-4,  # by the import from the pressure, in float32
    "CNDC": 1e-4,  # at gaps of depth, where the pressure is made of it
    "WAYPOINT_LATITUDE": DEGREE, "WAYPOINT_LONGITUDE": DEGREE,
    "LATITUDE_ONBOARD": DEGREE, "LONGITUDE_ONBOARD": DEGREE,
    "DOXY": 1e-4, "TIME": 1e-6, "TIME_DEPTH": 1e-3, "TIME_ATTITUDE": 1e-3, "TIME_CTD": 1e-3,
}  # fmt: skip
"""Variables that are made again or stored in another frame, and by how much they may differ, by the
float32 of what they are made of. All others are equal."""


def values_of(variable):
    return np.ma.filled(np.ma.asarray(variable[...], float), np.nan)


def assert_same_files(first, second):
    with netCDF4.Dataset(first) as a, netCDF4.Dataset(second) as b:
        assert set(a.variables) == set(b.variables)
        for name in a.variables:
            if a[name].dtype is str:
                assert str(a[name][...]) == str(b[name][...]), name
                continue
            np.testing.assert_allclose(
                values_of(b[name]), values_of(a[name]), rtol=0, atol=EXCEPTIONS.get(name, 0.0),
                err_msg=name,
            )  # fmt: skip
            for attribute in set(a[name].ncattrs()) | set(b[name].ncattrs()):
                assert str(a[name].getncattr(attribute)) == str(b[name].getncattr(attribute)), name
        changing = {"date_created", "history", "source"}
        for attribute in set(a.ncattrs()) - changing:
            wanted = a.getncattr(attribute)
            if isinstance(wanted, float):
                assert b.getncattr(attribute) == pytest.approx(wanted, abs=1e-4), attribute
            else:
                assert b.getncattr(attribute) == wanted, attribute


def again(run, folder):
    """The files of a store, what the import makes of them, and the files of that."""
    first = EXPORTERS["og1"].export(run, range(len(run)), folder / "first")
    back = LogStore(stored(folder / "again.zarr", "og1", first))
    return first, back, EXPORTERS["og1"].export(back, range(len(back)), folder / "second")


def rich(dataset):
    """With parts, payload and commands that the fixture's log has not."""
    shape = dataset["measured_pitch"].shape
    ramp = np.where(
        np.isfinite(dataset["measured_pitch"].values), np.linspace(-20.0, 20.0, shape[1]), np.nan
    )
    declare_parts(load_vehicle("tethys"))  # whose elevator it is
    declare(
        Variable("measured_oxygen", "umol L-1", "dissolved oxygen",
                 "mole_concentration_of_dissolved_molecular_oxygen_in_sea_water",
                 (-10.0, 1000.0), True)
    )  # fmt: skip
    declare(
        Variable("measured_chlorophyll", "ug L-1", "chlorophyll by its fluorescence",
                 "mass_concentration_of_chlorophyll_in_sea_water", (-10.0, 1000.0), True)
    )  # fmt: skip
    for name, values in (
        ("measured_elevator", ramp),
        ("commanded_pitch", ramp),
        ("measured_fin", 0.5 * ramp),
        ("measured_oxygen", 250.0 + ramp),
        ("measured_chlorophyll", np.where(ramp > 5.0, np.nan, 0.5)),
        ("measured_current_north", 0.01 * ramp),
        ("measured_onboard_north", 10.0 * (ramp - ramp[:, :1])),
        ("measured_onboard_east", 5.0 * (ramp - ramp[:, :1])),
    ):
        dataset[name] = (("mission", "time"), values.astype(np.float32))
    return dataset


@pytest.mark.parametrize("kind", ["slocum", "seaglider"])
def test_a_log_comes_back_as_it_was(kind, tmp_path):
    (tmp_path / "deployment.yml").write_text(
        'metadata: {title: Salmon, institution: The Gulf, comment: Ice., wmo_id: "68"}\n'
        "glider_devices: {ctd: {make_model: SBE 41CP, serial_number: 9028}}\n"
    )
    write = {"slocum": write_slocum, "seaglider": write_basestation}[kind]
    dataset, _ = import_logs(kind, write(tmp_path, FLIGHT), period=4.0)
    dataset = rich(dataset) if kind == "seaglider" else dataset
    dataset["measured_gap"][1, 40:45] = 1.0
    logs = LogStore(write_store(dataset, tmp_path / "store" / "log.zarr"))
    (first,), back, (second,) = again(logs, tmp_path / "files")
    assert_same_files(first, second)
    assert back.signals() == logs.signals()
    assert (back.period, back.splits, back.deployments) == (
        logs.period, logs.splits, logs.deployments
    )  # fmt: skip
    np.testing.assert_array_equal(back.samples, logs.samples)
    for name in ("dive_duration", "displacement_north", "surface_duration"):
        # of the stay before the first dive the file has only the last fix
        np.testing.assert_allclose(back.number(name)[1:], logs.number(name)[1:], atol=1e-9)
    for name in logs.signals():
        for row in range(len(logs)):
            x, y = logs.signal(name, row)[1:-1], back.signal(name, row)[1:-1]
            inside = logs.signal("measured_gap", row)[1:-1] > 0.0  # never measured, not written
            atol = (
                0.1 if "waypoint" in name or "onboard" in name else 1e-4 if "_t" in name else 1e-3
            )
            np.testing.assert_allclose(y[~inside], x[~inside], rtol=0, atol=atol, err_msg=name)


def test_simulated_missions_come_back_with_place_and_date(field_store, tmp_path):
    flown = simulated_flight(tmp_path, "slocum-200", current="uniform:0.1,0.05", yos=1)
    for run in (open_exportable(flown), GeneratedStore(field_store)):
        (path,) = EXPORTERS["og1"].export(run, [0], tmp_path / run.path.stem)
        dataset, report = import_logs("og1", [path])
        names = {str(name) for name in dataset.data_vars}
        assert set(run.signals()) <= names
        assert report.period == run.period
        start = dataset["start_time"].values[0]
        with netCDF4.Dataset(path) as file:
            first = round((float(start) - float(file["DEPLOYMENT_TIME"][...])) / run.period)
            if first == 0:
                for axis in ("latitude", "longitude"):
                    place = float(file[f"DEPLOYMENT_{axis.upper()}"][...])
                    assert float(dataset[f"start_{axis}"][0]) == pytest.approx(place, abs=1e-9)
        n = int(dataset["n_samples"][0])
        metres = ("true_north", "true_east", "measured_onboard", "measured_gps")
        for name in run.signals():
            if name.startswith(metres) or name in ("measured_depth", "measured_pressure"):
                continue
            stored = run.row(name, 0)[first : first + n].astype(float)
            stored = np.mod(stored, 360.0) if "heading" in name else stored
            np.testing.assert_allclose(
                dataset[name].values[0, 1 : n - 1], stored[1 : n - 1], atol=1e-4, err_msg=name
            )


def test_oxygen_is_per_mass_in_the_file_and_per_volume_in_a_store():
    """35 of salinity at 10 degC: 1026.95 kg/m3 by TEOS-10, whatever the depth."""
    time = np.arange(3.0)
    water = {
        "measured_salinity": Channel(time, np.full(3, 35.0)),
        "measured_temperature": Channel(time, np.full(3, 10.0)),
    }
    deep = Channel(time, np.array([0.0, 100.0, 200.0]))
    for units in ("micromole/kg", "umol kg-1", "micromole_per_kilogram"):
        found = oxygen_per_volume(
            Channel(time, np.full(3, 250.0)), {"units": units}, "DOXY", water, deep, Tally()
        )
        np.testing.assert_allclose(found.values, 250.0 * 1.02695, rtol=2e-5)
    same = oxygen_per_volume(deep, {"units": "micromole/L"}, "DOXY", {}, deep, Tally())
    assert same is deep
    tally = Tally()
    assert not len(oxygen_per_volume(deep, {"units": "umol/kg"}, "DOXY", {}, deep, tally))
    assert "without salinity" in tally.entries()[0].detail
