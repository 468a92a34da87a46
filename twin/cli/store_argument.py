"""Store argument: a store as the user names it, by a path or by an address."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.constructors import PrimitiveConstructorSpec

from twin.records.store_path import StorePath, Url, store_path

StoreArgument = Annotated[
    StorePath,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="STORE",
        instance_from_str=lambda words: store_path(words[0]),
        is_instance=lambda value: isinstance(value, Path | Url),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""Type of an argument: the path of a folder, or s3://BUCKET/NAME, gs://... or az://..."""
