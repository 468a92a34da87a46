"""Control tasks for a glider in the manner of `dm_control.suite`, on the twin's own physics.

`load("hold", task_kwargs={"random": 1})` returns a `dm_env` environment; `ALL_TASKS` names them:
hold heading and pitch, reach a depth, follow waypoints in a current, save energy. The model and
the native callbacks are those of the batch. `twin.gym` gives the same tasks to Gymnasium, and
`python -m twin.suite --task hold` shows one in the dm_control viewer.
"""

from twin.suite.backend import choose_backend
from twin.suite.requirement import require_dm_control

require_dm_control()
choose_backend()  # dm_control settles how it draws while it is imported

from twin.suite.loader import ALL_TASKS, load  # noqa: E402
from twin.suite.registry import TASKS, register  # noqa: E402

__all__ = ["ALL_TASKS", "TASKS", "load", "register"]
