"""Faults injected into the writers, some of those of `python -m benchmarks.faults`."""

from __future__ import annotations

import dataclasses
import json

import pytest

from benchmarks.faults.__main__ import inject, inject_all
from benchmarks.faults.campaign import Campaign
from benchmarks.faults.injector import FAULTS, Fault, compiler
from benchmarks.faults.writers import WRITERS

pytestmark = pytest.mark.skipif(compiler() is None, reason="the injector needs a C compiler")

EVERY = {"whole_folder": 7, "whole_file": 2, "write_whole": 1, "fit-network": 7}
"""Every which operation of a writer fails here"""
LONG = ("simulate", "import", "save", "generate", "fit", "export-og1")


@pytest.fixture(scope="module")
def outcomes():
    """What each writer went through."""
    asked = [Campaign(name, every) for name, every in EVERY.items()]
    for name in sorted({*WRITERS} - {*EVERY}):
        asked.append(Campaign(name, 400 if name in LONG else 60, (Fault.KILL.name,)))
    return {found["writer"]: found for found in inject_all(asked)}


@pytest.mark.parametrize("name", EVERY)
def test_no_fault_loses_anything(name, outcomes):
    found = outcomes[name]
    assert found["lost"] == [], found["trace"]
    assert found["survived"] == found["injected"] >= len(FAULTS)


@pytest.mark.parametrize("name", sorted({*WRITERS} - {*EVERY}))
def test_a_kill_leaves_the_old_content_or_the_new(name, outcomes):
    found = outcomes[name]
    assert found["lost"] == [], found["trace"]
    assert found["survived"] == found["injected"] >= 1


def test_a_writer_that_is_not_whole_is_found(monkeypatch, tmp_path):
    """The injector and its judge notice what a plain writer loses."""
    import textwrap

    from benchmarks.faults.injector import run_injected

    program = textwrap.dedent(
        """
        import sys
        from pathlib import Path
        from benchmarks.faults import campaign
        from benchmarks.faults.writers import Writer
        def prepare(inputs):
            return lambda path, variant: path.write_text(3000 * variant)
        campaign.WRITERS["plain"] = Writer("plain", "plain.txt", prepare)
        campaign._count = lambda *_: 2
        print(len(campaign.run(campaign.Campaign("plain"), Path(sys.argv[1])).lost))
        """
    )
    ended = run_injected("-c", program, str(tmp_path / "work"), folder=tmp_path)
    assert int(ended.stdout) >= 5, ended.stderr


def test_a_campaign_goes_on_from_its_journal(tmp_path):
    journal = tmp_path / "journal.jsonl"
    asked = Campaign("whole_file", faults=(Fault.KILL.name,), journal=str(journal))
    stopped = inject(dataclasses.replace(asked, seconds=0.0))
    assert (stopped["injected"], stopped["planned"]) == (0, stopped["operations"])
    assert inject(asked)["injected"] == stopped["planned"]
    head, *lines = journal.read_text().splitlines()
    assert len(lines) == stopped["planned"]
    # what the journal says is not tried again
    fault, at, _ = json.loads(lines[0])
    journal.write_text("\n".join([head, json.dumps([fault, at, "made up"]), *lines[1:], ""]))
    assert inject(asked)["lost"] == [f"{fault} at operation {at}: made up"]
    journal.write_text(json.dumps(["whole_file", 1]) + "\n")
    with pytest.raises(RuntimeError, match="the writer has changed"):
        inject(asked)
