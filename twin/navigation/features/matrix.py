"""Matrix: the features of one mission, whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.navigation.features.base import Channels
from twin.navigation.features.registry import channels_of, feature
from twin.navigation.features.selection import leave_out


def feature_matrix(
    signals: Channels, features: Sequence[str], period: float, mission: int
) -> NDArray[np.float32]:
    """Features (time, features) of one mission, in their own units.

    Raises:
      StoreError: a channel is missing or holds a value that is not finite; the mission, the
        channel and the first such sample are named.
    """
    for channel in channels_of(features):
        if channel not in signals:
            raise StoreError(f"mission {mission} has no channel {channel}")
        bad = np.flatnonzero(~np.isfinite(signals[channel]))
        if bad.size:
            raise StoreError(
                f"channel {channel} of mission {mission} is not finite at {bad.size} samples, "
                f"first at {bad[0] * period:.1f} s; repair the store{leave_out([channel])}"
            )
    columns = [feature(name).compute(signals, period) for name in features]
    return np.stack(columns, axis=1).astype(np.float32)
