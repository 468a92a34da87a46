"""Camera: the block of water that a picture shows, its scales, and the viewpoint.

In a picture that spans kilometres, a 2 m glider would be invisible. So the glider keeps its size of
about 2 display units, and the sea is scaled down around it: by a horizontal scale, and a vertical
scale that may exaggerate depth. The chase camera keeps true scale.

`fit` frames the whole block; `View` projects points into the picture, for labels.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from twin.frames import flip_vector

Array = NDArray[np.float64]

EXAGGERATIONS = (1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0)
HEIGHT_RATIO = {"orbit": 0.30, "side": 0.46, "map": 0.30}
"""Height / length of the water block at which the automatic exaggeration aims, by camera, for
the aspect WIDESCREEN; a taller picture gets a taller block."""
WIDESCREEN = 16 / 9
WIDTH_RATIO = {"orbit": 0.28, "side": 0.28, "map": 0.55, "chase": 0.28}
"""Smallest width / length of the block, so that a straight track has a body of water around it."""
MARGIN = 0.07  # margin around the track / its length
BELOW = 0.12  # height of the water below the deepest point / depth of this point
LEAST_DEPTH, LEAST_LENGTH = 5.0, 12.0  # [m] least depth and length of the block
VEHICLE_SHARE = 0.095  # length of the glider / width of the view
VIEW_MARGIN = 1.25  # approximate width of the view / length of the block: sets the scale
SIDE_SHARE = 0.04  # free margin on each side without a HUD / size of the picture

NARROW, WIDE = math.radians(14.0), math.radians(24.0)
"""[rad] Half of a vertical field of view. NARROW: framed cameras. WIDE: chase camera."""
ORBIT_ELEVATION, SIDE_ELEVATION = math.radians(24.0), math.radians(9.0)
ORBIT_SWEEP = math.radians(110.0)  # [rad] sweep of the orbit camera in a video, about the broadside
ORBIT_STILL = math.radians(32.0)  # [rad] bearing of a still from the broadside view
CHASE_DISTANCE = 4.1  # [m] distance of the chase camera from the glider
CHASE_BEARING, CHASE_ELEVATION = math.radians(142.0), math.radians(16.0)
"""[rad] Chase camera from the glider. CHASE_BEARING: bow to starboard. CHASE_ELEVATION: up"""
CHASE_HEIGHT = CHASE_DISTANCE * math.sin(CHASE_ELEVATION)
"""[m] Height of the chase camera above the glider"""
CHASE_LAG = 1.2  # [s of video] time constant with which the chase camera follows a turn
INSET_BEARING, INSET_ELEVATION = math.radians(58.0), math.radians(24.0)
INSET_HALF, INSET_DISTANCE = math.radians(13.0), 4.4  # half the field of view; [m]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Frame:
    """Margins that framing keeps free, as fractions of the picture's height and width."""

    aspect: float  # width / height of the picture
    bottom: float = SIDE_SHARE
    top: float = SIDE_SHARE
    left: float = SIDE_SHARE
    right: float = SIDE_SHARE

    @property
    def filled(self) -> float:
        """Height of the filled area, as a fraction of the picture's."""
        return 1.0 - self.bottom - self.top


@dataclasses.dataclass(frozen=True, kw_only=True)
class SceneLayout:
    """Block of water in metres, and the scales to display units.

    The block's axes are x along `azimuth` (from north towards east), y to its right, z down.
    """

    azimuth: float  # [rad]
    low: Array  # [m] least x, y of the block and 0, shape (3,)
    high: Array  # [m] largest x, y of the block and its depth, shape (3,)
    scale: float  # display units per metre, horizontally
    exaggeration: float  # vertical over horizontal scale

    @property
    def centre(self) -> Array:
        """Middle of the block's surface, NED [m], shape (3,)."""
        middle = (self.low + self.high) / 2
        return self.to_ned(np.array([middle[0], middle[1], 0.0]))

    @property
    def size(self) -> Array:
        """Length, width, depth [m], shape (3,)."""
        return self.high - self.low

    @property
    def factors(self) -> Array:
        """Display units per metre along x, y, z, shape (3,)."""
        return self.scale * np.array([1.0, 1.0, self.exaggeration])

    @property
    def broadside(self) -> float:
        """Bearing [rad] from which the block's x axis runs to the right of the picture."""
        return -(self.azimuth + math.pi / 2)

    def to_ned(self, block: Array) -> Array:
        """Convert block axes to NED [m], shape (..., 3)."""
        return np.asarray(block) @ self._turn().T

    def to_block(self, ned: Array) -> Array:
        """Convert NED to block axes [m], shape (..., 3)."""
        return np.asarray(ned) @ self._turn()

    def display(self, ned: Array) -> Array:
        """Convert NED [m] to display units, z up, origin at the middle of the block's surface."""
        return flip_vector(np.asarray(ned) - self.centre) * self.factors

    def display_block(self, block: Array) -> Array:
        """Convert block axes [m] to display units."""
        return self.display(self.to_ned(block))

    def corners(self) -> Array:
        """Corners of the block in display units: surface, then floor, shape (8, 3)."""
        (x0, y0, _), (x1, y1, z1) = self.low, self.high
        xy = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        return self.display_block(np.array([(x, y, z) for z in (0.0, z1) for x, y in xy]))

    def _turn(self) -> Array:
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def plan(
    paths: list[Array],
    *,
    hull_length: float,
    floor: float | None,
    exaggeration: float | None,
    camera: str,
    frame: Frame,
) -> SceneLayout:
    """Plan the layout that contains all `paths`, each (n, 3) NED [m].

    Args:
      hull_length: [m] length of the glider's hull.
      floor: [m] depth of the block's floor; None for a little below the deepest point.
      exaggeration: vertical over horizontal scale; None for automatic.
      camera: as in `Shot`. The map's block is aligned with north, other blocks with the track;
        the chase camera has one display unit per metre and no exaggeration.
      frame: margins of the picture; the map's block fills the rest.
    """
    points = np.concatenate(paths)
    azimuth = 0.0 if camera == "map" else principal_azimuth(points[:, :2])
    trial = SceneLayout(
        azimuth=azimuth, low=np.zeros(3), high=np.ones(3), scale=1.0, exaggeration=1.0
    )
    inside = trial.to_block(points)
    low, high = inside.min(axis=0), inside.max(axis=0)
    length = max(float(max(high[0] - low[0], high[1] - low[1])), LEAST_LENGTH)
    middle = (low + high) / 2
    half = np.maximum((high - low) / 2 + MARGIN * length, WIDTH_RATIO[camera] * length / 2)
    if camera == "map":
        wide = frame.aspect * (1.0 - frame.left - frame.right) / frame.filled
        half[:2] = np.maximum(half[:2], [half[1] / wide, half[0] * wide])
    depth = max(float(high[2]) * (1 + BELOW), LEAST_DEPTH)
    if floor is not None:
        depth = max(floor, float(high[2]) + 1e-3)
    low, high = middle - half, middle + half
    low[2], high[2] = 0.0, depth
    if camera == "chase":
        scale, exaggeration = 1.0, 1.0
    else:
        longest = float(max(high[:2] - low[:2]))
        scale = min(1.0, hull_length / (VEHICLE_SHARE * (longest * VIEW_MARGIN)))
        if exaggeration is None:
            ratio = HEIGHT_RATIO[camera] * min(max(WIDESCREEN / frame.aspect, 0.5), 2.0)
            wanted = max(ratio * longest / depth, 1e-9)
            exaggeration = min(EXAGGERATIONS, key=lambda e: abs(math.log(e / wanted)))
    return dataclasses.replace(trial, low=low, high=high, scale=scale, exaggeration=exaggeration)


def principal_azimuth(horizontal: Array) -> float:
    """[rad] Azimuth, from north towards east, along which points (n, 2) vary most."""
    centred = horizontal - horizontal.mean(axis=0)
    if np.abs(centred).max(initial=0.0) < 1e-6:
        return 0.0
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    if np.dot(horizontal[-1] - horizontal[0], axis) < 0:
        axis = -axis
    return math.atan2(axis[1], axis[0])


def ticks(low: float, high: float, *, about: int = 5) -> Array:
    """Round values from `low` to `high`, about `about` of them, shape (n,)."""
    step = nice_step((high - low) / about)
    return np.asarray(step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step) + 1))


def nice_step(rough: float) -> float:
    """Round `rough` to the nearest 1, 2 or 5 times a power of ten, on a logarithmic scale."""
    power = 10.0 ** math.floor(math.log10(rough))
    steps = (m * power for m in (1.0, 2.0, 5.0, 10.0))
    return min(steps, key=lambda s: abs(math.log(s / rough)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class View:
    """Camera in display units, z up, in the form of MuJoCo's renderer."""

    position: Array  # shape (3,)
    forward: Array  # unit, shape (3,)
    up: Array  # unit, perpendicular to `forward`, shape (3,)
    half_height: float
    """Half height of the filled part: tangent of the angle, or display units if `parallel`"""
    frame: Frame
    parallel: bool = False
    near: float = 0.05
    far: float = 2000.0

    @functools.cached_property
    def right(self) -> Array:
        """Unit vector to the right of the picture, shape (3,)."""
        return np.cross(self.forward, self.up)

    def frustum(self) -> tuple[float, float, float, float]:
        """Horizontal centre, half width, bottom and top of the near plane, in display units."""
        unit = 1.0 if self.parallel else self.near
        filled = self.frame.filled
        height = 2 * self.half_height * unit / filled
        low = -height * (self.frame.bottom + filled / 2)
        half_width = height * self.frame.aspect / 2
        return half_width * (self.frame.right - self.frame.left), half_width, low, low + height

    def project(self, points: Array) -> Array:
        """Picture coordinates of points (n, 3), shape (n, 3): x from the left and y from the top, 0
        to 1, and distance along the view. Points behind the camera get NaN."""
        relative = np.asarray(points) - self.position
        along = relative @ self.forward
        shrink = np.ones_like(along)
        if not self.parallel:
            seen = along > self.near
            shrink = np.where(seen, self.near / np.where(seen, along, 1.0), np.nan)
        centre, half_width, low, high = self.frustum()
        x = ((relative @ self.right) * shrink - centre) / half_width / 2 + 0.5
        y = 1.0 - ((relative @ self.up) * shrink - low) / (high - low)
        return np.stack([x, y, along], axis=-1)


def direction(bearing: float, elevation: float) -> tuple[Array, Array]:
    """Unit vectors forward and up of a camera that looks from a direction [rad] at the origin.

    Bearing counts from the display's x axis (north) to its y axis (west).
    """
    c, s = math.cos(bearing), math.sin(bearing)
    ce, se = math.cos(elevation), math.sin(elevation)
    return np.array([-c * ce, -s * ce, -se]), np.array([-c * se, -s * se, ce])


def fit(points: Array, forward: Array, up: Array, *, half_height: float, frame: Frame) -> View:
    """Perspective view along `forward` that just contains all points (n, 3) in the frame."""
    tangent = math.tan(half_height) * frame.filled
    half_width = math.tan(half_height) * frame.aspect * (1.0 - frame.left - frame.right)
    right = np.cross(forward, up)
    target = points.mean(axis=0)
    for _ in range(20):  # move the target to the middle of the projected points; converges fast
        relative = points - target
        x, y, z = relative @ right, relative @ up, relative @ forward
        distance = float(np.max(np.maximum(np.abs(x) / half_width, np.abs(y) / tangent) - z))
        distance = max(distance, 1e-3)
        across, above = x / (distance + z), y / (distance + z)
        middle_x, middle_y = ((a.max() + a.min()) / 2 for a in (across, above))
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
    """View of a camera that shows the whole block.

    Args:
      camera: map; side, across the track, slightly from above; orbit, circling the block.
      phase: 0 to 1, the orbit's progress in a video, 0.5 the broadside view; None for a still.
    """
    if camera == "map":
        return map_view(layout, frame)
    turned, elevation = 0.0, SIDE_ELEVATION
    if camera == "orbit":
        turned = ORBIT_STILL if phase is None else ORBIT_SWEEP * (phase - 0.5)
        elevation = ORBIT_ELEVATION
    forward, up = direction(layout.broadside + turned, elevation)
    return fit(layout.corners(), forward, up, half_height=NARROW, frame=frame)


def map_view(layout: SceneLayout, frame: Frame) -> View:
    """View from straight above, north up, parallel projection."""
    corners = layout.corners()[:4]
    middle = (corners.max(axis=0) + corners.min(axis=0)) / 2
    span = corners.max(axis=0) - corners.min(axis=0)
    # Display x (north) runs up the picture and -y (east) to the right.
    wide = frame.aspect * (1.0 - frame.left - frame.right)
    height = 10.0 + 0.05 * float(layout.size[2] * layout.factors[2])
    return View(
        position=middle + np.array([0.0, 0.0, height]),
        forward=np.array([0.0, 0.0, -1.0]),
        up=np.array([1.0, 0.0, 0.0]),
        half_height=max(span[0] / 2, span[1] / 2 * frame.filled / wide),
        frame=frame,
        parallel=True,
        near=0.1,
        far=20.0 * float(np.linalg.norm(layout.size * layout.factors)) + 200.0,
    )


def chase_view(heading: float, frame: Frame) -> View:
    """View from behind the glider at the origin; `follow` has smoothed its `heading` [rad]."""
    forward, up = direction(-(heading + CHASE_BEARING), CHASE_ELEVATION)
    return View(
        position=-CHASE_DISTANCE * forward,
        forward=forward,
        up=up,
        half_height=math.tan(WIDE) * frame.filled,
        frame=dataclasses.replace(frame, left=0.0, right=0.0),
    )


def inset_view(centre: Array, heading: float, aspect: float) -> View:
    """Close-up view of the glider at `centre` (3,) from its starboard bow, without roll."""
    forward, up = direction(-(heading + INSET_BEARING), INSET_ELEVATION)
    return View(
        position=centre - INSET_DISTANCE * forward,
        forward=forward,
        up=up,
        half_height=math.tan(INSET_HALF),
        frame=Frame(aspect=aspect, bottom=0.0, top=0.0, left=0.0, right=0.0),
        near=0.2,
    )


def follow(angle: Array, frames_per_second: float, lag: float = CHASE_LAG) -> Array:
    """Smooth angles [rad, unwrapped] by a first-order `lag` [s], for a camera that follows.

    The filter starts settled at the first angle, so that a video does not begin with a swing.
    """
    weight = 1.0 - math.exp(-1.0 / (frames_per_second * lag))
    lagging = itertools.accumulate(angle, lambda before, now: before + weight * (now - before))
    return np.fromiter(lagging, float)
