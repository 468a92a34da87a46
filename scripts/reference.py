"""The list of checksums of a reference set, from a store that its recipe made.

python scripts/reference.py STORE assets/reference/NAME.json

A new version of the physics makes new lists: generate the store with the command that the recipe
names (`factory generate --preset PRESET --hours HOURS --seed SEED`), then call this.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from factory.generation.generated_store import open_missions
from twin.records.storage.checksums import array_checksums


def main(store: Path, out: Path) -> None:
    """Write the list."""
    made = open_missions(store)
    entry = {
        **{name: made.attributes[name] for name in ("preset", "hours", "seed")},
        "physics": int(made.settings["versions"]["physics"]),
        "arrays": array_checksums(store),
    }
    out.write_text(json.dumps(entry, indent=1) + "\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
