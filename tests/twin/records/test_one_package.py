"""What a store is, is known in one package: nothing else names its attributes or opens zarr."""

import re
from pathlib import Path

import pytest

from twin.records import attributes

ROOT = Path(__file__).resolve().parents[3]
OURS = ROOT / "twin" / "records"
ZARR = re.compile(r"open_zarr|to_zarr|\bzarr\.|import zarr|from zarr|\bZarr")
ELSEWHERE = {
    # gridded currents of other programs, which may be zarr
    "twin/water/current/velocity_file.py"
}
NAMES = (
    *(attributes.VERSION, attributes.SAMPLE_PERIOD, attributes.FAILED_MISSIONS),
    *(attributes.VEHICLE_MJCF, attributes.VEHICLE_SHA256, attributes.SOURCE_FORMAT),
    *(attributes.IMPORT_REPORT, attributes.PROGRAM_VERSION, attributes.N_SAMPLES),
    *(attributes.START_TIME, attributes.DIVE_DURATION),
)
"""Names that mean a store's attribute or bookkeeping array wherever they stand."""


def without_text(source):
    """A module without docstrings and comments."""
    source = re.sub(r'"""(?:.|\n)*?"""', "", source)
    return re.sub(r"#.*", "", source)


MODULES = [
    path
    for package in ("twin", "factory", "learn")
    for path in sorted((ROOT / package).rglob("*.py"))
    if OURS not in path.parents
]


def test_zarr_is_opened_and_written_here_only():
    found = {
        str(path.relative_to(ROOT))
        for path in MODULES
        if ZARR.search(without_text(path.read_text()))
    }
    assert found <= ELSEWHERE


def test_the_names_of_attributes_are_spelt_here_only():
    spelt = re.compile("|".join(f"[\"']{name}[\"']" for name in NAMES))
    found = {
        f"{path.relative_to(ROOT)}: {match.group()}"
        for path in MODULES
        for match in spelt.finditer(without_text(path.read_text()))
    }
    assert not found


@pytest.mark.parametrize("text", ["xr.open_zarr(p)", "d.to_zarr(p)", "import zarr", "zarr.open(p)"])
def test_the_search_would_find_it(text):
    assert ZARR.search(without_text(f'"""zarr."""\n{text}'))
    assert not ZARR.search(without_text('"""zarr.json"""  # zarr.open'))
