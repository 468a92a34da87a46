"""OtherKind: a file of another kind than the logs that are read; offload folders hold some."""

from __future__ import annotations

from twin.errors import InputError


class OtherKind(InputError):
    """A file without logs of this kind; a folder is read without it, and that is not an error."""
