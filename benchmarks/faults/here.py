"""Here: an executor that runs everything at once in this process, where faults can be injected."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Here(Executor):
    """Runs what it is given before `submit` returns."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future that has its result; raises what `fn` raises."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
