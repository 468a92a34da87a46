"""Reader of rosbag2's folders: metadata.yaml beside files of SQLite (.db3) or MCAP."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from factory.importing.deployment_log import DeploymentLog
from factory.importing.formats.base import ReadOptions, WrongFormat
from factory.importing.formats.mcap_reader import read_recordings
from factory.importing.formats.mcap_recording import SAID
from factory.importing.tally import Tally
from twin.errors import InputError


def read_rosbag2(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """One log for each folder: all its files together.

    Raises:
      ModuleNotFoundError: rosbags is not installed.
      WrongFormat: an MCAP file alone.
      InputError: a file without its metadata.yaml; else as `read_mcap`.
    """
    lost = [path for path in paths if not (path.parent / SAID).is_file()]
    if lost and lost[0].suffix.lower() == ".mcap":
        raise WrongFormat(lost[0], (), kind="mcap")
    if lost:
        raise InputError(
            f"{lost[0].name} has no {SAID} beside it, which names its topics: `ros2 bag reindex` "
            "makes it"
        )
    folders = dict.fromkeys(path.resolve().parent for path in paths)
    return read_recordings(list(folders), options, tally)
