"""Lanes on three processors: one log, made by vector code."""

from benchmarks.lanes_hash import HERE, VEHICLES, on_processor, processors
from twin.fossen.structure import Arithmetic


def test_one_log_and_vector_code_on_every_processor():
    """Vector code on all; the log on the two that differ most: without fused operations and with
    the narrowest vectors, and on this machine's own, whose code other tests need too and which has
    the widest. `python -m benchmarks.lanes_hash` asks for all."""
    logs, everywhere = set(), (*processors()[:-1], HERE)
    for processor in everywhere:
        hashed = ("glider",) if processor in (everywhere[0], HERE) else ()
        found = on_processor(processor, hashed=hashed, counted=VEHICLES)
        logs |= {log for ways in found["hashes"].values() for log in ways.values()}
        for vehicle, counts in found["arithmetic"].items():
            code = Arithmetic(counts["packed"], counts["scalar"], tuple(counts["calls"]))
            assert code.packed > 1000, (processor, vehicle)
            assert code.vector_code, (processor, vehicle, code)
    assert len(logs) == 1, logs
