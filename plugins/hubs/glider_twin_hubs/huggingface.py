"""Hugging Face: export of missions as Parquet files per split, with a data card.

The data card is the README.md of a data set. Its front matter, which hubs read, lists the files of
each split and the licence's identifier.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from factory.exporting import Advance, ExportOptions, FlatTable, Metadata, metadata_for
from factory.generation import GeneratedStore
from twin import __version__
from twin.cli import counted
from twin.records import SPLITS, LogStore, MissionStore
from twin.records.attributes import COMMENT, HISTORY, PLATFORM, TITLE
from twin.records.coordinates import NOMINAL, NOMINAL_WORDS
from twin.records.schema import VARIABLES

UNKNOWN, OTHER = "unknown", "other"
"""Licences of data. UNKNOWN: without a stated licence. OTHER: with one that hubs do not list"""
KNOWN = frozenset(
    {
        *("apache-2.0", "mit", "bsd-2-clause", "bsd-3-clause", "cc0-1.0"),
        *("cc-by-3.0", "cc-by-4.0", "cc-by-sa-3.0", "cc-by-sa-4.0", "cc-by-nc-4.0"),
        *("cc-by-nc-sa-4.0", "cc-by-nc-nd-4.0", "cc-by-nd-4.0", "odbl", "odc-by", "pddl"),
        *("cdla-permissive-1.0", "cdla-permissive-2.0", "etalab-2.0", "gpl-3.0", "eupl-1.2"),
    }
)
"""Licence identifiers for data in Hugging Face's list"""
_URL = re.compile(r"creativecommons\.org/(?:licenses/([a-z-]+)|publicdomain/(zero))/(\d\.\d)")
_WORDS = {"creative commons attribution": "cc-by", "creative commons": "cc", "public domain": ""}


def licence_identifier(text: str) -> str:
    """Identifier of a licence on hubs: `unknown` without a licence, `other` if hubs do not list it.

    Args:
      text: licence in any usual form: CC-BY-4.0, CC BY 4.0, a URL of Creative Commons.
    """
    said = " ".join(text.lower().split())
    if not said or said == UNKNOWN:
        return UNKNOWN
    if found := _URL.search(said):
        kind, zero, version = found.groups()
        said = f"cc0-{version}" if zero else f"cc-{kind}-{version}"
    for words, short in _WORDS.items():
        said = said.replace(words, short)
    plain = re.sub(
        r"[\s_/]+", "-", re.sub(r"\b(licen[cs]e|international|the)\b|[().,;]$", "", said)
    )
    plain = plain.strip("-.")
    return plain if plain in KNOWN else OTHER


SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"),
         (10**7, "1M<n<10M"), (10**8, "10M<n<100M"), (10**9, "100M<n<1B"))  # fmt: skip
"""Hubs' size classes, each with the number of rows below which it holds"""
LARGEST = "n>1B"
TAGS = ("underwater-glider", "oceanography", "time-series", "navigation")
SOFTWARE = "glider-twin"


def split_name(word: str) -> str:
    """Split of the data set for a mission's split; a mission without a split is for training."""
    return word if word in SPLITS else "train"


def write_card(
    folder: Path,
    run: MissionStore,
    missions: Sequence[int],
    metadata: Metadata,
    configs: Sequence[Mapping[str, Any]],
    *,
    tags: Sequence[str],
    layout: str,
) -> Path:
    """Write README.md into a folder.

    Args:
      missions: missions in the data set.
      metadata: title, summary, license, citation, references and others, as the user gave them.
      configs: front matter with the files of each split.
      tags: tags to add to TAGS.
      layout: paragraph on files and columns, in Markdown.
    """
    import yaml

    said = metadata.attributes
    rows = int(run.samples[list(missions)].sum())
    licence = said.get("license", "")
    identifier = licence_identifier(licence)
    title = _title(run, metadata)
    front: dict[str, Any] = {"license": identifier}
    if identifier == OTHER:
        front |= {"license_name": "as-stated", "license_link": "README.md"}
    front |= {
        "pretty_name": title,
        "task_categories": ["time-series-forecasting", "robotics"],
        "tags": [*tags, *TAGS],
        "size_categories": [next((word for most, word in SIZES if rows < most), LARGEST)],
        "configs": list(configs),
    }
    parts = [
        f"---\n{yaml.safe_dump(front, sort_keys=False, allow_unicode=True)}---\n\n# {title}",
        _what(run, missions, rows, metadata),
        f"## Files\n\n{layout}",
        _splits(run, missions),
        _licence(licence, identifier),
        _citation(said),
        _signals(run),
        _origin(run),
    ]
    path = folder / "README.md"
    path.write_text("\n\n".join(part for part in parts if part) + "\n", encoding="utf-8")
    return path


def _title(run: MissionStore, metadata: Metadata) -> str:
    title = metadata.attributes.get("title") or str(run.attributes.get(TITLE, run.path.stem))
    return title if run.logged or "simulated" in title.lower() else f"SIMULATED: {title}"


def _what(run: MissionStore, missions: Sequence[int], rows: int, metadata: Metadata) -> str:
    said = metadata.attributes
    hours = rows * run.period / 3600.0
    if run.logged:
        made = f"Logged by {run.attributes.get(PLATFORM, 'an unknown vehicle')}"
        if isinstance(run, LogStore) and run.simulated:
            made += " (the logs are marked as those of a simulation)"
    else:
        made = f"**Simulated**: no vehicle has measured this. Vehicle model: {run.vehicle.name}"
    lines = [
        said.get("summary", ""),
        f"{made}. {counted(len(missions), 'dive' if run.logged else 'mission')}, {hours:.4g} h, "
        f"{rows} samples, one every {run.period:g} s.",
        str(run.attributes.get(COMMENT, "")),
    ]
    if NOMINAL in run:
        flags = run.array(NOMINAL)
        words = sorted({NOMINAL_WORDS[int(flags[mission])] for mission in missions} - {"none"})
        if words:
            lines.append(f"Nobody said the {words[0]} of some missions: there defaults stand.")
    return "\n\n".join(line for line in lines if line)


def _splits(run: MissionStore, missions: Sequence[int]) -> str:
    lines = ["## Splits", "", "A mission belongs to one split only.", ""]
    lines += ["| split | missions | samples |", "|---|---|---|"]
    for split in SPLITS:
        some = [mission for mission in missions if split_name(run.splits[mission]) == split]
        if some:
            lines.append(f"| {split} | {len(some)} | {int(run.samples[some].sum())} |")
    return "\n".join(lines)


def _licence(text: str, identifier: str) -> str:
    unknown = (
        "Not stated: the licence of these data is unknown. Ask who made them before you publish or "
        "build on them."
    )
    return f"## Licence\n\n{unknown if identifier == UNKNOWN else text}"


def _citation(said: Mapping[str, str]) -> str:
    lines = ["## Citation", ""]
    given = [said[name] for name in ("citation", "references", "doi") if said.get(name)]
    people = [said[name] for name in ("creator_name", "institution", "project") if said.get(name)]
    lines += given or ["No citation was given for these data."]
    if people:
        lines += ["", f"Made by {', '.join(dict.fromkeys(people))}."]
    if said.get("acknowledgement"):
        lines += ["", said["acknowledgement"]]
    return "\n".join(lines)


def _signals(run: MissionStore) -> str:
    lines = [
        "## Signals",
        "",
        "`true_*` is what happened, `measured_*` what the sensors said, `commanded_*` what was "
        "asked for. NaN is a gap: no fix, no lock, no setpoint.",
        "",
        "| signal | unit | meaning |",
        "|---|---|---|",
    ]
    for name in run.signals():
        entry = VARIABLES[name]
        meaning = f"{entry.long_name}; {entry.comment}" if entry.comment else entry.long_name
        lines.append(f"| `{name}` | {entry.units} | {meaning.replace('|', ' ')} |")
    return "\n".join(lines)


def _origin(run: MissionStore) -> str:
    lines = ["## How it was made", "", f"Exported by {SOFTWARE} {__version__}."]
    if isinstance(run, GeneratedStore):
        settings = run.settings
        lines.append(
            f"Preset {settings['preset']}, seed {run.seed}, sensors {run.sensor_preset}, by "
            f"{SOFTWARE} {settings['versions']['glider-twin']}."
        )
    history = " ".join(str(run.attributes.get(HISTORY, "")).split())
    return "\n".join([*lines, "", f"    {history}"] if history else lines)


LARGEST_FILE = 400_000_000
"""[byte] File size after which a split continues in another file; hubs ask for below 500 MB"""
FOLDER = "data"
LAYOUT = (
    "`data/SPLIT-NNNNN.parquet`: a row for every sample, a row group for every mission. The "
    "columns `mission` and `time` [s] say where a row belongs; `datetime` is UTC, `latitude` and "
    "`longitude` are WGS84.\n\n"
    "```python\n"
    "import datasets\n\n"
    'missions = datasets.load_dataset("this/folder")\n'
    'missions["train"].with_format("numpy")["measured_pitch"]\n'
    "```"
)


def export_huggingface(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    """Write the missions by split, and README.md.

    Raises:
      ModuleNotFoundError: pyarrow is not installed.
      OSError: the disk refuses.
      StoreError: a mission is missing or cannot be read.
    """
    flat = FlatTable(run)
    (folder / FOLDER).mkdir()
    written: list[Path] = []
    configs = []
    for split in SPLITS:
        some = [mission for mission in missions if split_name(run.splits[mission]) == split]
        if some:
            tables = _advancing((flat.rows(mission) for mission in some), advance)
            written += write_files(tables, flat.schema, folder / FOLDER, split)
            configs.append({"split": split, "path": f"{FOLDER}/{split}-*.parquet"})
    files = [{"config_name": "default", "data_files": configs}]
    said = metadata_for(run, options.metadata)
    about = write_card(folder, run, missions, said, files, tags=("tabular",), layout=LAYOUT)
    return [about, *written]


def write_files(tables: Iterator[Any], schema: Any, folder: Path, name: str) -> list[Path]:
    """Write tables in order into files `NAME-NNNNN.parquet` of bounded size."""
    pq = import_module("pyarrow.parquet")
    written: list[Path] = []
    writer = None
    try:
        for table in tables:
            if writer is None:
                written.append(folder / f"{name}-{len(written):05d}.parquet")
                writer = pq.ParquetWriter(written[-1], schema, compression="zstd")
            writer.write_table(table)
            if written[-1].stat().st_size > LARGEST_FILE:
                writer.close()
                writer = None
    finally:
        if writer is not None:
            writer.close()
    return written


def _advancing(tables: Iterator[Any], advance: Advance) -> Iterator[Any]:
    for table in tables:
        yield table
        advance()
