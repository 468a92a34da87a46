"""Lanes on three processors: one log, made by vector code."""

from __future__ import annotations

from benchmarks.lanes_hash import VEHICLES, on_processor, processors
from twin.fossen.structure import Arithmetic


def test_one_log_and_vector_code_on_every_processor() -> None:
    logs = set()
    for processor in processors():
        found = on_processor(processor, hashed=("glider",), counted=VEHICLES)
        logs |= set(found["hashes"]["glider"].values())
        for vehicle, counts in found["arithmetic"].items():
            code = Arithmetic(counts["packed"], counts["scalar"], tuple(counts["calls"]))
            assert code.packed > 1000, (processor, vehicle)
            assert code.vector_code, (processor, vehicle, code)
    assert len(logs) == 1, logs
