"""Logs of a vehicle that the tests know: simulated, exported as OG1.0 and imported as real ones."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np

import twin
from factory.exporting import EXPORTERS
from factory.generation.generated_store import open_exportable
from factory.importing.import_run import import_logs
from twin.mission import Mission
from twin.mission.segments import SawTooth, Surface
from twin.records.store import write_store
from twin.vehicle.vehicle import Vehicle

PERIOD = 2.0
DEEPEST = 60.0
"""[m] of its dives"""
PITCH, CLIMB_PITCH = 24.0, 27.0
"""[deg] of its dives and climbs"""
HEADING = 40.0
"""[deg true]"""


def mission(yos: int = 2) -> Mission:
    """Dives along one heading, from fix to fix."""
    dives = SawTooth(
        heading_deg=HEADING,
        max_depth_m=DEEPEST,
        pitch_deg=PITCH,
        climb_pitch_deg=CLIMB_PITCH,
        net_mass_kg=0.2,
        yos=float(yos),
    )
    return Mission(
        name="one heading",
        segments=(Surface(duration_s=60.0), dives, Surface(duration_s=120.0)),
        start_heading_deg=HEADING - 20.0,
    )


def simulated_flight(
    folder: Path,
    vehicle: Vehicle | str,
    *,
    yos: int = 2,
    sensors: str = "field",
    current: str | None = None,
    density: str | None = None,
) -> Path:
    """A store of one flight of `vehicle` at a place and a date."""
    flown = twin.simulate(
        mission=mission(yos),
        vehicle=vehicle,
        current=current,
        density=density,
        start={"latitude": 49.0, "longitude": -16.0, "time": "2003-08-01T00:00"},
        sensors=sensors,
    )
    return flown.save(folder / "flown.zarr")


def simulated_log(folder: Path, vehicle: Vehicle, *, yos: int = 2, sensors: str = "field") -> Path:
    """A store of logs of `vehicle`, made from an OG1.0 file."""
    saved = simulated_flight(folder, vehicle, yos=yos, sensors=sensors)
    files = EXPORTERS["og1"].export(open_exportable(saved), [0], folder / "og1", lambda: None)
    with netCDF4.Dataset(files[0], "a") as file:  # a real vehicle knows its place by fixes alone
        file["DEPLOYMENT_LATITUDE"][...] = np.nan
    dataset, _ = import_logs("og1", files, period=PERIOD)
    # what the vehicle did, as most logs have it, and not what it was asked for
    dataset = dataset.drop_vars([n for n in dataset.data_vars if str(n).startswith("commanded_")])
    return write_store(dataset, folder / "log.zarr")
