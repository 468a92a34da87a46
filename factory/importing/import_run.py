"""Import run: read the logs of one kind of vehicle into a dataset of dives and a report."""

from __future__ import annotations

import copy
import dataclasses
import difflib
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.cleaning import within_limits
from factory.importing.deployment_log import OF_THE_MACHINE, UNREADABLE, each_file, failed_reading
from factory.importing.dives.dive_store import build
from factory.importing.formats.base import (
    IMPORTERS,
    LONGEST,
    SHORTEST,
    Importer,
    Reader,
    ReadOptions,
    WrongFormat,
    check_plugin,
    kind_that_takes,
)
from factory.importing.given_files import expand
from factory.importing.netcdf import holds_arrays
from factory.importing.payload import parse_payload
from factory.importing.plausibility import DiveRules
from factory.importing.tally import ImportReport, OtherKind, Tally, summarise
from twin.errors import InputError
from twin.plugins import imported, installation
from twin.records.attributes import DEPLOYMENT_METADATA, HISTORY, made_at

if TYPE_CHECKING:
    import xarray as xr

    from factory.importing.deployment_log import DeploymentLog


def import_logs(
    kind: str,
    files: Sequence[Path | str],
    *,
    period: float | None = None,
    rules: DiveRules | None = None,
    variation_deg: float | None = None,
    cache: Path | None = None,
    mapping: Path | str | None = None,
    camera: Path | None = None,
    log: Path | None = None,
    marker_side: float | None = None,
    payload: Sequence[str] = (),
    doppler: Sequence[Path | str] = (),
    keep_going: bool = True,
    recursive: bool = False,
    one_deployment: bool = False,
) -> tuple[xr.Dataset, ImportReport]:
    """Read logs, cut them into dives, and put these on one time grid.

    Args:
      kind: a name in `factory.importing.IMPORTERS`, such as slocum.
      files: files or folders.
      period: [s] sampling interval [default: the log's own if it states one, else the importer's].
      rules: limits by which a log is cut into dives.
      variation_deg: [degree] magnetic variation, east positive, instead of the log's own.
      cache: folder of a Slocum's cache files [default: beside the logs].
      mapping: meaning of the columns of csv tables: a file, or the name of a shipped mapping.
      camera: calibration of the camera, as OpenCV writes it, for a video of markers.
      log: log of the vehicle in the video, of any kind that can be imported.
      marker_side: [m] black square of the markers [default: 0.15].
      payload: NAME=COLUMN or NAME=COLUMN[UNITS]: each column becomes the signal `measured_NAME`,
        in addition to the known payloads (`factory.importing.payload`).
      doppler: PD0 files, or folders of them, of the Doppler log that the vehicle carried.
      keep_going: go on even if half of the files or more cannot be read.
      recursive: search the folders below the named ones too.
      one_deployment: treat all logs as one deployment, with the name of the earliest log.

    Raises:
      InputError: a file cannot be used; the message names the file and the reason.
    """
    stamp = made_at().strftime("%Y-%m-%dT%H:%M:%SZ")
    importer, rules = IMPORTERS[kind], rules or DiveRules()
    if period is not None and not SHORTEST <= period <= LONGEST:
        raise InputError(f"period must be within {SHORTEST:g} to {LONGEST:g} s, not {period:g}")
    if variation_deg is not None and not -180.0 <= variation_deg <= 180.0:
        raise InputError(f"magnetic variation must be within +-180 degree, not {variation_deg:g}")
    if cache is not None and not importer.takes_cache:
        takers = ", ".join(one.name for one in IMPORTERS.values() if one.takes_cache)
        raise InputError(f"{kind} logs have no cache files: leave --cache out (it is for {takers})")
    if mapping is not None and not importer.takes_mapping:
        takers = ", ".join(one.name for one in IMPORTERS.values() if one.takes_mapping)
        raise InputError(f"{kind} logs have names of their own: leave --mapping out ({takers})")
    filmed = {"camera": camera, "log": log, "marker_side": marker_side}
    filmed = {name: value for name, value in filmed.items() if value is not None}
    if filmed and not importer.takes_camera:
        option = next(iter(filmed)).replace("_", "-")
        raise InputError(f"{kind} logs are no videos: leave --{option} out (it is for markers)")
    tally = Tally()
    options = ReadOptions(
        variation_deg=variation_deg, cache=cache, mapping=mapping, payload=parse_payload(payload),
        **filmed,  # type: ignore[arg-type]
    )  # fmt: skip
    paths, logs = read_logs(
        kind, files, options, tally, keep_going=keep_going, recursive=recursive
    )  # fmt: skip
    if doppler:
        logs = _with_doppler(kind, logs, doppler, tally, recursive=recursive)
    if one_deployment:
        first = min((log for log in logs if log.channels), key=lambda one: one.span, default=None)
        logs = [dataclasses.replace(log, deployment=(first or log).deployment) for log in logs]
    _expect_mapped(options, tally)
    read = {name for log in logs for name in log.files}
    own = [log.period for log in logs if log.period is not None]
    try:
        dataset, report = build(
            logs, kind=kind, period=period or min(own, default=importer.period), rules=rules,
            tally=tally, held=importer.held, lacks=importer.lacks,
            files=[path.name for path in paths if path.name in read] or [p.name for p in paths],
        )  # fmt: skip
    except InputError as error:
        raise _with_left_out(error, tally) from error
    command = ["factory", "import", kind, *map(str, files)]
    for name, value in (
        ("period", period),
        ("min-depth", None if rules.min_depth == DiveRules().min_depth else rules.min_depth),
        ("variation-deg", variation_deg),
        ("cache", cache),
        ("mapping", mapping),
        *((name.replace("_", "-"), value) for name, value in filmed.items()),
    ):
        command += [] if value is None else [f"--{name}", str(value)]
    command += ["--payload", *payload] if payload else []
    command += ["--doppler", *map(str, doppler)] if doppler else []
    command += ["--recursive"] if recursive else []
    dataset.attrs[HISTORY] = f"{stamp}: {shlex.join(command)}"
    text = _metadata_text(paths) or (logs[0].said if len(logs) == 1 else None)
    if text is not None:
        dataset.attrs[DEPLOYMENT_METADATA] = text
    return dataset, report


def read_logs(
    kind: str,
    files: Sequence[Path | str],
    options: ReadOptions,
    tally: Tally,
    *,
    keep_going: bool = True,
    recursive: bool = False,
) -> tuple[list[Path], list[DeploymentLog]]:
    """Read logs without cutting them; return the files and a log for each deployment.

    Raises:
      InputError: see `import_logs`.
    """
    importer = IMPORTERS[kind]
    try:
        paths = expand(importer, [Path(f) for f in files], tally, recursive=recursive)
        logs = [
            dataclasses.replace(
                within_limits(log, tally),  # with the reader's doubts about it
                doubts=tuple(d for d in tally.doubts if d.deployment in ("", log.deployment)),
            )
            for log in _read(importer, paths, options, tally)
        ]
        if not keep_going:
            _expect_most(len({name for log in logs for name in log.files}), tally)
    except WrongFormat as error:
        raise _explained(error, importer) from error
    except MostUnreadable:
        raise
    except InputError as error:
        raise _with_left_out(error, tally) from error
    return paths, logs


def _with_doppler(
    kind: str,
    logs: Sequence[DeploymentLog],
    files: Sequence[Path | str],
    tally: Tally,
    *,
    recursive: bool,
) -> list[DeploymentLog]:
    """Add a Doppler log's files to the logs of the vehicles that carried it."""
    from factory.importing.formats.pd0_reader import with_doppler

    importer = IMPORTERS["pd0"]
    if kind == importer.name:
        raise InputError(
            "--doppler adds a Doppler log to its vehicle's log, and pd0 files are Doppler logs: "
            "name the kind and the files of the vehicle, or leave --doppler out"
        )
    try:
        paths = expand(importer, [Path(f) for f in files], tally, recursive=recursive)
        return with_doppler(logs, paths, tally)
    except WrongFormat as error:
        raise _explained(error, importer) from error


METADATA = ("metadata.yml", "deployment.yml", "metadata.yaml", "deployment.yaml")
"""Names under which pyglider and similar tools store the description of a deployment."""
BAG = "rosbag2_bagfile_information"
"""First word of rosbag2's own metadata.yaml, which describes no deployment."""


def _metadata_text(paths: Sequence[Path]) -> str | None:
    """Text of the only metadata file in the logs' folders; None if there is none or several."""
    folders = dict.fromkeys(path.resolve().parent for path in paths)
    found = [folder / name for folder in folders for name in METADATA if (folder / name).is_file()]
    texts = [path.read_text(encoding="utf-8", errors="replace") for path in found]
    texts = [text for text in texts if not text.startswith(BAG)]
    return texts[0] if len(texts) == 1 else None


def _read(
    importer: Importer, paths: Sequence[Path], options: ReadOptions, tally: Tally
) -> list[DeploymentLog]:
    read: Reader = imported(importer.read) if isinstance(importer.read, str) else importer.read
    trial = copy.deepcopy(tally)
    try:
        try:
            logs = read(paths, options, trial)
        except (InputError, *OF_THE_MACHINE):
            tally.take(trial)
            raise
        except Exception as error:
            return _read_others(importer, read, paths, options, tally, error)
    except ModuleNotFoundError as error:
        if importer.extra is None:
            raise
        raise InputError(
            f"these {importer.name} logs need the package {error.name}, which is not installed: "
            f"{installation(importer.extra)}"
        ) from error
    tally.take(trial)
    return logs


def _read_others(
    importer: Importer, read: Reader, paths: Sequence[Path], options: ReadOptions, tally: Tally,
    error: Exception,
) -> list[DeploymentLog]:  # fmt: skip
    """Read the remaining files, without the files at which the reader fails alone.

    Raises:
      InputError: no file is left, or the reader fails at no single file.
    """

    def read_alone(path: Path) -> None:
        try:
            read([path], options, Tally())
        except OtherKind:
            raise
        except InputError:
            return  # not damaged; it may need another file

    good = [path for path, _ in each_file(paths, read_alone, tally)]
    if len(good) == len(paths):
        names = summarise([path.name for path in paths], 3)
        raise InputError(
            f"{names}: the {importer.name} reader fails at them together, and at none alone "
            f"({failed_reading(paths[0], error)}); import them in smaller groups to find the pair"
        ) from error
    return _read(importer, good, options, tally)


def _expect_most(read: int, tally: Tally) -> None:
    """Raise `MostUnreadable` unless more files were read than were unreadable."""
    lost = [e for e in tally.entries() if e.subject == UNREADABLE]
    count = sum(entry.count for entry in lost)
    if count and count >= read:
        reasons = "; ".join(entry.detail for entry in lost[:_REASONS])
        more = f"; and {len(lost) - _REASONS} more reasons" if len(lost) > _REASONS else ""
        raise MostUnreadable(
            f"{count} files cannot be read, half or more: {reasons}{more}; repair that, or "
            "import the rest with --keep-going"
        )


_REASONS = 3
"""Largest number of reasons that an error lists."""


class MostUnreadable(InputError):
    """Error of an import: half of the files or more cannot be read; the message says why."""


def _with_left_out(error: InputError, tally: Tally) -> InputError:
    """Return the error with the unreadable files added: the missing data may be in them."""
    left_out = [e.detail for e in tally.entries() if e.subject == UNREADABLE]
    if all(why in str(error) for why in left_out):
        return error
    return InputError(f"{error}; left out before: {summarise(left_out, 2)}")


def _expect_mapped(options: ReadOptions, tally: Tally) -> None:
    """Raise InputError if no file has the column of a payload that the user maps."""
    names = [name for states in tally.names.values() for name in states]
    for one in options.payload:
        if not set(one.sources) & set(names):
            near = difflib.get_close_matches(one.sources[0], names, n=3)
            raise InputError(
                f"payload {one.signal}: no file has the column {one.sources[0]!r}"
                + (f"; is it {', '.join(near)}?" if near else "")
            )


def _explained(error: WrongFormat, importer: Importer) -> InputError:
    """Return the error with the kind of log that the file looks like."""
    path, kind = error.path, error.kind
    check_plugin(path, error.names)
    if kind is None and error.names:
        arrays = holds_arrays(path)
        kind = kind_that_takes(path, error.names, arrays=arrays, others=(importer.name,))
    what = f"{path.name} is not a log of the kind {importer.name}"
    if kind is not None and kind != importer.name:
        return InputError(f"{what}, it looks like {kind}: use `factory import {kind}`")
    why = f": {error.why}" if error.why else ""
    return InputError(f"{what} as it is known here{why}; it holds {error.some}")
