"""Records: missions in memory (trajectories) and in stores (zarr, netCDF)."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.records import attributes as attributes
    from twin.records import coordinates as coordinates
    from twin.records.attributes import SPLITS as SPLITS
    from twin.records.coordinates import unix_seconds as unix_seconds
    from twin.records.logged import LogStore as LogStore
    from twin.records.logged import log_rows as log_rows
    from twin.records.mission_dataset import dataset_of as dataset_of
    from twin.records.mission_dataset import summarise as summarise
    from twin.records.presence import is_derived as is_derived
    from twin.records.presence import is_flight as is_flight
    from twin.records.presence import is_store as is_store
    from twin.records.presence import read_attributes as read_attributes
    from twin.records.reader import MissionStore as MissionStore
    from twin.records.storage.whole import whole_file as whole_file
    from twin.records.store import check_target as check_target
    from twin.records.store import read_trajectory as read_trajectory
    from twin.records.store import read_zarr as read_zarr
    from twin.records.store import write_store as write_store
    from twin.records.store import write_zarr as write_zarr
    from twin.records.timeseries import FIXES as FIXES
    from twin.records.timeseries import sample_coordinates as sample_coordinates
    from twin.records.tracks import NamedTrack as NamedTrack
    from twin.records.tracks import choose_tracks as choose_tracks
    from twin.records.tracks import read_tracks as read_tracks

__getattr__, __dir__ = attach(__name__, places(__name__))
