"""Camera: where each frame is seen from, framed so that everything fits.

`View` is one camera as MuJoCo's renderer takes it, with the projection that puts labels where the
picture shows their points.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from twin.show.render.scene_geometry import Frame, SceneLayout

Array = NDArray[np.float64]

NARROW, WIDE = math.radians(14.0), math.radians(24.0)
"""Half of the vertical field of view: of the framed cameras, and of the chase camera."""
ORBIT_ELEVATION = math.radians(24.0)
SIDE_ELEVATION = math.radians(9.0)
ORBIT_SWEEP = math.radians(110.0)
"""How far the orbit camera travels in one video, about the broadside view."""
ORBIT_STILL = math.radians(32.0)
"""Bearing of a still from the broadside view"""
CHASE_DISTANCE = 4.1
"""[m] behind and beside the glider"""
CHASE_BEARING = math.radians(142.0)
"""From the bow, to starboard: mostly from behind"""
CHASE_ELEVATION = math.radians(16.0)
CHASE_HEIGHT = CHASE_DISTANCE * math.sin(CHASE_ELEVATION)
"""[m] of the chase camera above the glider"""
CHASE_LAG = 1.2
"""[s of video] with which the chase camera follows a turn"""
INSET_BEARING, INSET_ELEVATION = math.radians(58.0), math.radians(24.0)
INSET_HALF = math.radians(13.0)
INSET_DISTANCE = 4.4
"""[m]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class View:
    """A camera in display units, z up."""

    position: Array
    """Shape (3,)"""
    forward: Array
    """Unit, shape (3,)"""
    up: Array
    """Unit, across `forward`, shape (3,)"""
    half_height: float
    """Of the part of the picture that framing fills: tangent of the angle, or units if parallel"""
    frame: Frame
    parallel: bool = False
    near: float = 0.05
    far: float = 2000.0

    @functools.cached_property
    def right(self) -> Array:
        """Unit vector to the right of the picture, shape (3,)."""
        return np.cross(self.forward, self.up)

    def frustum(self) -> tuple[float, float, float]:
        """Half width, bottom and top at the near plane, in display units."""
        unit = 1.0 if self.parallel else self.near
        filled = self.frame.filled
        height = 2 * self.half_height * unit / filled
        low = -height * (self.frame.bottom + filled / 2)
        return height * self.frame.aspect / 2, low, low + height

    def centre(self) -> float:
        """Horizontal middle of the picture at the near plane, in display units."""
        return self.frustum()[0] * (self.frame.right - self.frame.left)

    def project(self, points: Array) -> Array:
        """Picture coordinates of points (n, 3): x from the left, y from the top, both 0 to 1; and
        the distance along the view, shape (n, 3). Points behind the camera get NaN."""
        relative = np.asarray(points) - self.position
        along = relative @ self.forward
        if self.parallel:
            shrink = np.ones_like(along)
        else:
            shrink = np.where(
                along > self.near, self.near / np.where(along > 0, along, 1.0), np.nan
            )
        half_width, low, high = self.frustum()
        x = ((relative @ self.right) * shrink - self.centre()) / half_width / 2 + 0.5
        y = 1.0 - ((relative @ self.up) * shrink - low) / (high - low)
        return np.stack([x, y, along], axis=-1)


def direction(bearing: float, elevation: float) -> tuple[Array, Array]:
    """Forward and up of a camera that looks from `bearing` and `elevation` [rad] at the origin.

    Bearing counts from the display's x axis (north) to its y axis (west).
    """
    c, s = math.cos(bearing), math.sin(bearing)
    ce, se = math.cos(elevation), math.sin(elevation)
    return np.array([-c * ce, -s * ce, -se]), np.array([-c * se, -s * se, ce])


def fit(points: Array, forward: Array, up: Array, *, half_height: float, frame: Frame) -> View:
    """The perspective view along `forward` that just holds all points (n, 3) in the frame."""
    tangent = math.tan(half_height) * frame.filled
    half_width = math.tan(half_height) * frame.aspect * (1.0 - frame.left - frame.right)
    right = np.cross(forward, up)
    target = points.mean(axis=0)
    for _ in range(20):  # the target moves to the middle of what is seen; it settles quickly
        relative = points - target
        x, y, z = relative @ right, relative @ up, relative @ forward
        distance = float(np.max(np.maximum(np.abs(x) / half_width, np.abs(y) / tangent) - z))
        distance = max(distance, 1e-3)
        left_right = x / (distance + z)
        up_down = y / (distance + z)
        middle_x = (left_right.max() + left_right.min()) / 2
        middle_y = (up_down.max() + up_down.min()) / 2
        target = target + distance * (middle_x * right + middle_y * up)
    reach = float(np.linalg.norm(points - target, axis=-1).max())
    return View(
        position=target - distance * forward,
        forward=forward,
        up=up,
        half_height=tangent,
        frame=frame,
        near=max(0.02, 0.1 * max(distance - reach, 0.2)),
        far=8.0 * (distance + reach),
    )


def block_view(camera: str, layout: SceneLayout, frame: Frame, phase: float | None) -> View:
    """The view of a camera that shows the whole block.

    Args:
      camera: map; side, across the track, a little from above; orbit, circling the block.
      phase: 0 to 1, the orbit's progress in a video, 0.5 the broadside view; None: of a still.
    """
    if camera == "map":
        return map_view(layout, frame)
    turned, elevation = 0.0, SIDE_ELEVATION
    if camera == "orbit":
        turned = ORBIT_STILL if phase is None else ORBIT_SWEEP * (phase - 0.5)
        elevation = ORBIT_ELEVATION
    forward, up = direction(broadside(layout) + turned, elevation)
    return fit(layout.corners(), forward, up, half_height=NARROW, frame=frame)


def map_view(layout: SceneLayout, frame: Frame) -> View:
    """From straight above, north up, parallel projection."""
    corners = layout.corners()[:4]
    middle = (corners.max(axis=0) + corners.min(axis=0)) / 2
    span = corners.max(axis=0) - corners.min(axis=0)
    # Display x (north) runs up the picture and -y (east) to the right.
    wide = frame.aspect * (1.0 - frame.left - frame.right)
    half = max(span[0] / 2, span[1] / 2 * frame.filled / wide)
    deep = float(layout.size[2] * layout.factors[2])
    height = 10.0 + 0.05 * deep
    return View(
        position=middle + np.array([0.0, 0.0, height]),
        forward=np.array([0.0, 0.0, -1.0]),
        up=np.array([1.0, 0.0, 0.0]),
        half_height=half,
        frame=frame,
        parallel=True,
        near=0.1,
        far=20.0 * float(np.linalg.norm(layout.size * layout.factors)) + 200.0,
    )


def chase_view(heading: float, frame: Frame) -> View:
    """Behind the glider, which is at the origin; `heading` [rad] already follows with a lag."""
    forward, up = direction(-(heading + CHASE_BEARING), CHASE_ELEVATION)
    return View(
        position=-CHASE_DISTANCE * forward,
        forward=forward,
        up=up,
        half_height=math.tan(WIDE) * frame.filled,
        frame=dataclasses.replace(frame, left=0.0, right=0.0),
    )


def inset_view(centre: Array, heading: float, aspect: float) -> View:
    """Close-up of the glider at `centre` (3,) from its starboard bow, level with the world."""
    forward, up = direction(-(heading + INSET_BEARING), INSET_ELEVATION)
    return View(
        position=centre - INSET_DISTANCE * forward,
        forward=forward,
        up=up,
        half_height=math.tan(INSET_HALF),
        frame=Frame(aspect=aspect, bottom=0.0, top=0.0, left=0.0, right=0.0),
        near=0.2,
    )


def broadside(layout: SceneLayout) -> float:
    """Bearing from which the block's x axis runs to the right of the picture."""
    return -(layout.azimuth + math.pi / 2)


def follow(angle: Array, frames_per_second: float, lag: float = CHASE_LAG) -> Array:
    """Angles [rad, unwrapped] of a camera that follows `angle` with a first-order lag [s].

    It starts settled on the first angle, so that a video does not begin with a swing.
    """
    weight = 1.0 - math.exp(-1.0 / (frames_per_second * lag))
    out = np.array(angle, float)
    for i in range(1, len(out)):
        out[i] = out[i - 1] + weight * (angle[i] - out[i - 1])
    return out
