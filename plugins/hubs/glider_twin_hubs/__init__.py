"""Hubs: the export formats `huggingface` and `lerobot`, for data hubs."""

from factory.exporting import Exporter

HUGGINGFACE = Exporter(
    name="huggingface",
    title="Hugging Face data set: Parquet files of each split and a data card",
    ending="-huggingface",
    write="glider_twin_hubs.huggingface:export_huggingface",
    takes=("metadata",),
    extra="parquet",
)
"""Export of a store as a folder that `datasets.load_dataset` opens."""

LEROBOT = Exporter(
    name="lerobot",
    title="LeRobot data set v3.0: an episode for every mission, states, actions, statistics",
    ending="-lerobot",
    write="glider_twin_hubs.lerobot:export_lerobot",
    takes=("metadata",),
    extra="parquet",
)
"""Export of a store as a folder that `LeRobotDataset` opens."""
