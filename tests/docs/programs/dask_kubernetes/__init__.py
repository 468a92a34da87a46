"""Stands for dask-kubernetes in the tests of docs/howto/cluster.md."""
