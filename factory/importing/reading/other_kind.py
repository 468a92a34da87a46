"""OtherKind: a file that is no log of the kind that is read, as offload folders hold some."""

from __future__ import annotations

from twin.errors import InputError


class OtherKind(InputError):
    """A file without logs of the kind: left out of a folder, which is no failure."""
