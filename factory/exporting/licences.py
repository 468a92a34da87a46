"""Licences: the identifier that data hubs know for what people wrote as a licence."""

from __future__ import annotations

import re

UNKNOWN, OTHER = "unknown", "other"
"""Identifiers for data of which nobody said a licence, and for one that hubs do not list"""
KNOWN = frozenset(
    {
        *("apache-2.0", "mit", "bsd-2-clause", "bsd-3-clause", "cc0-1.0"),
        *("cc-by-3.0", "cc-by-4.0", "cc-by-sa-3.0", "cc-by-sa-4.0", "cc-by-nc-4.0"),
        *("cc-by-nc-sa-4.0", "cc-by-nc-nd-4.0", "cc-by-nd-4.0", "odbl", "odc-by", "pddl"),
        *("cdla-permissive-1.0", "cdla-permissive-2.0", "etalab-2.0", "gpl-3.0", "eupl-1.2"),
    }
)
"""Those of Hugging Face's list that data have"""
_URL = re.compile(r"creativecommons\.org/(?:licenses/([a-z-]+)|publicdomain/(zero))/(\d\.\d)")
_WORDS = {"creative commons attribution": "cc-by", "creative commons": "cc", "public domain": ""}


def licence_identifier(text: str) -> str:
    """What a hub calls a licence: `unknown` for none, `other` for one that is not on its list.

    Args:
      text: as people write it: CC-BY-4.0, CC BY 4.0, an address of Creative Commons.
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
