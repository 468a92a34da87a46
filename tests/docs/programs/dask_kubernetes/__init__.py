"""Stands for dask-kubernetes in the tests of docs/cluster.md."""
