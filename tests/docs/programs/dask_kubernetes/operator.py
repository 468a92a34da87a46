"""Its cluster, with workers on this machine."""

from __future__ import annotations

from typing import Any

from dask.distributed import LocalCluster


class KubeCluster(LocalCluster):
    def __init__(
        self, *, name: str, image: str, n_workers: int, env: dict[str, str], resources: Any
    ):
        assert image
        assert env
        assert set(resources) == {"requests"}
        few = min(n_workers, 2)
        super().__init__(n_workers=few, threads_per_worker=1, name=name, dashboard_address=None)
