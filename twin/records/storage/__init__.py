"""How records reach a disk or an object store: whole or not at all, checksummed, in shards."""
