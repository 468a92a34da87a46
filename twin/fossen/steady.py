"""Steady glides and spirals of the Fossen equations, and their stability.

A motion is steady when the body velocity, roll, pitch and the turn rate about the vertical are
constant: six accelerations vanish for the six unknowns (u, v, w, roll, pitch, turn rate).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.errors import NoSteadyState
from twin.fossen.equations import mass_distribution, still_acceleration
from twin.fossen.forces import ForceParameters, damping_wrench, pumped
from twin.numbers import Array
from twin.vehicle.steady_motion import DISTINCT_ROOTS, Trim, solve_steady_state

DEEP = 1e4
"""[m] Depth of the steady motion, at which the hull is immersed at any pitch."""
NEUTRAL = 1e-9
"""[kg] Net mass, without its sign, below which a vehicle counts as neutral and does not glide."""
ROTATION_STEP = math.radians(5.0)
"""[rad] Largest step in rotation when a spiral is continued from the straight glide."""
SMALLEST_STEP = math.radians(0.05)
"""[rad] Smallest step in rotation, at which the continuation ends: the spirals have a fold."""
SCAN_POINTS = 721
"""Number of angles of attack, from -180 to 180 deg, searched for straight glides."""
SPEED_ROUNDS, SPEED_SETTLED = 30, 1e-4
"""SPEED_ROUNDS: steps of the iteration for the speed of a straight glide. SPEED_SETTLED: relative
change at which it ends; the result is a guess for the root finder."""
SETTLE_TIME = 3000.0
"""[s] Duration of a settling flight: fifty times the Sea-Wing's slowest decay at usual net mass."""
EDGE_POINTS = 41
"""Number of angles of attack between two neighbours of the scan whose lifts differ in sign."""
SLOW_GROWTH = 5e-4
"""[1/s] Growth rate up to which a motion counts as stable: a disturbance doubles in 23 minutes."""
DIFFERENCE_STEP = 1e-6
"""[SI] Step of the linearisation's central differences, near the cube root of epsilon."""


@dataclass(frozen=True, kw_only=True)
class SteadyMotion:
    """One steady motion of the Fossen equations."""

    trim: Trim
    nu_r: Array
    """Velocity through the water [m/s] and body rates [rad/s], shape (6,), body FRD."""
    eigenvalues: Array
    """[1/s] Complex eigenvalues, shape (8,), of the motion in nu_r, roll, pitch; slowest last."""

    @property
    def stable(self) -> bool:
        """True when every small disturbance decays (heading and position stay free).

        A disturbance that doubles in more than 20 minutes counts as decaying: a hull with purely
        quadratic roll damping damps no small roll, and no flight is long enough to show the growth.
        """
        return bool(np.max(self.eigenvalues.real) < SLOW_GROWTH)

    @property
    def forward(self) -> bool:
        """True for a motion nose first; no coefficients were identified in reversed flow."""
        return bool(self.nu_r[0] > 0.0)


def down_axis(roll: float, pitch: float) -> Array:
    """NED down axis in body axes, shape (3,)."""
    level = math.cos(pitch)
    return np.array([-math.sin(pitch), level * math.sin(roll), level * math.cos(roll)])


class SteadyProblem:
    """Steady equations at fixed positions of the parts, shape (parts,)."""

    def __init__(
        self,
        p: ForceParameters,
        positions: Array,
        turning: int | None,
        driven: bool,
        *,
        request: str = "",
        hint: str = "give others",
    ):
        """`turning`: index of the part that turns the vehicle; `driven`: under a propeller.

        `request` describes the positions, and `hint` gives advice, both in messages.
        """
        self.request = request or ", ".join(f"{value:g}" for value in positions)
        self.hint = hint
        self.p = p
        self.positions = np.asarray(positions, dtype=np.float64)
        self.turning = turning
        self.driven = driven
        carried = mass_distribution(p, self.positions)[0] - p.mass
        volume = pumped(p, self.positions)[0]
        self.net_mass = float(carried - p.reference_density * 1e-6 * volume)
        """[kg] Net mass at reference density, positive heavy."""
        self._displaced = float(p.mass + p.reference_density * 1e-6 * volume)

    @property
    def rotation(self) -> float:
        """Position of the part that turns the vehicle; 0 without one."""
        return 0.0 if self.turning is None else float(self.positions[self.turning])

    def _acceleration(self, nu_r: Array, down: Array) -> Array:
        return still_acceleration(self.p, down, DEEP, nu_r, self.positions, self._displaced)

    @staticmethod
    def nu_r(x: Array) -> Array:
        """Vector nu_r, shape (6,), of the unknowns (u, v, w, roll, pitch, turn rate)."""
        return np.concatenate((x[:3], x[5] * down_axis(x[3], x[4])))

    def residual(self, x: Array) -> Array:
        """Accelerations, shape (6,), of the unknowns (u, v, w, roll, pitch, turn rate)."""
        return self._acceleration(self.nu_r(x), down_axis(x[3], x[4]))

    def rate(self, s: Array) -> Array:
        """Rate of (nu_r, roll, pitch), shape (8,)."""
        p, q, r, roll, pitch = s[3:]
        rate = np.empty(8)
        rate[:6] = self._acceleration(s[:6].copy(), down_axis(roll, pitch))
        turning = q * math.sin(roll) + r * math.cos(roll)
        rate[6] = p + turning * math.tan(pitch)
        rate[7] = q * math.cos(roll) - r * math.sin(roll)
        return rate

    def eigenvalues(self, x: Array) -> Array:
        """Eigenvalues [1/s], shape (8,), fastest decay first, of the motion about the root `x`."""
        s = np.concatenate((self.nu_r(x), x[3:5]))
        jacobian = np.empty((8, 8))
        for k in range(8):
            step = np.zeros(8)
            step[k] = DIFFERENCE_STEP
            jacobian[:, k] = (self.rate(s + step) - self.rate(s - step)) / (2 * DIFFERENCE_STEP)
        values = np.linalg.eigvals(jacobian).astype(complex)
        return values[np.argsort(values.real)]

    def straight_glide(self, alpha: float) -> Array | None:
        """Unknowns of the upright straight glide whose forces balance at `alpha` [rad].

        Speed and pitch follow from the resultant of lift and drag. None: the resultant points to
        the wrong side, where only an inverted glider could balance. The pitch moment is free. A law
        that is not purely quadratic is evaluated again at the speed found.
        """
        unit = np.array([math.cos(alpha), 0.0, math.sin(alpha), 0.0, 0.0, 0.0])
        side = math.copysign(1.0, self.net_mass)
        speed, pitch = 1.0, math.nan
        for turn in range(SPEED_ROUNDS):
            wrench = damping_wrench(self.p, speed * unit, self.p.reference_density) / speed**2
            resultant = math.hypot(wrench[0], wrench[2])
            if side * wrench[2] >= 0.0:
                return None
            found = math.sqrt(abs(self.net_mass) * self.p.gravity / resultant)
            if turn and abs(speed - found) < SPEED_SETTLED * found:
                break
            speed, pitch = found, math.asin(side * wrench[0] / resultant)
        return np.array([speed * unit[0], 0.0, speed * unit[2], 0.0, pitch, 0.0])

    def straight_roots(self) -> list[Array]:
        """Guesses for every straight glide, from the sign changes of the pitch acceleration."""
        angles = np.linspace(-math.pi, math.pi, SCAN_POINTS)
        balanced = [self.straight_glide(float(alpha)) is not None for alpha in angles]
        found = self._crossings(angles)
        for k in np.flatnonzero(np.diff(balanced)):  # one end has no lift: steep glides are here
            found += self._crossings(np.linspace(angles[k], angles[k + 1], EDGE_POINTS))
        return found

    def _crossings(self, angles: Array) -> list[Array]:
        """Straight glides where the pitch acceleration changes sign between angles of attack."""
        found: list[Array] = []
        previous: tuple[float, float] | None = None
        for alpha in angles:
            x = self.straight_glide(float(alpha))
            if x is None:
                previous = None
                continue
            moment = float(self.residual(x)[4])
            if previous is not None and previous[1] * moment <= 0.0:
                gap = previous[1] - moment
                part = previous[1] / gap if gap != 0.0 else 0.0
                between = self.straight_glide(previous[0] + part * (float(alpha) - previous[0]))
                if between is not None:
                    found.append(between)
            previous = (float(alpha), moment)
        return found

    def cruises(self) -> list[Array]:
        """Guesses for every straight motion under a propeller, at several pitches."""
        fast, slow = 20.0, 0.0
        for _ in range(60):
            middle = 0.5 * (fast + slow)
            nu_r = np.array([middle, 0.0, 0.0, 0.0, 0.0, 0.0])
            ahead = self._acceleration(nu_r, down_axis(0.0, 0.0))
            fast, slow = (fast, middle) if ahead[0] > 0.0 else (middle, slow)
        return [
            np.array([slow, 0.0, 0.0, 0.0, math.radians(pitch), 0.0])
            for pitch in (0.0, -10.0, 10.0, -30.0, 30.0)
        ]

    def straight_guesses(self) -> list[Array]:
        """Guesses for every straight motion, propelled or gliding."""
        return self.cruises() if self.driven else self.straight_roots()

    def with_rotation(self, rotation: float) -> SteadyProblem:
        """Make the problem with another position of the part that turns the vehicle."""
        positions = self.positions.copy()
        if self.turning is not None:
            positions[self.turning] = rotation
        return SteadyProblem(self.p, positions, self.turning, self.driven)


def _settle(problem: SteadyProblem, straight: Array) -> Array | None:
    """Follow the motion in time from `straight`; returns its end as a guess, None if it diverges.

    Stable motions attract, so this also finds motions that no family of spirals contains.
    """
    from scipy.integrate import solve_ivp

    start = np.concatenate((problem.nu_r(straight), straight[3:5]))
    tight: dict[str, Any] = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-9}
    found = solve_ivp(lambda t, s: problem.rate(s), (0.0, SETTLE_TIME), start, **tight)
    end = found.y[:, -1]
    if not (found.success and np.all(np.isfinite(end))):
        return None
    down = down_axis(end[6], end[7])
    return np.concatenate((end[:3], end[6:8], [float(end[3:6] @ down)]))


def _continue_spiral(problem: SteadyProblem, straight: Array) -> Array | None:
    """Follow one straight glide from rotation 0 to the problem's rotation, or None at a fold."""
    here, x = 0.0, straight
    slope = np.zeros(6)
    step = math.copysign(ROTATION_STEP, problem.rotation)
    while here != problem.rotation:
        target = here + step
        if (problem.rotation - target) * step <= 0.0:
            target = problem.rotation
        found = solve_steady_state(
            problem.with_rotation(target).residual, [x + slope * (target - here)]
        )
        if found:
            slope = (found[0] - x) / (target - here)
            here, x = target, found[0]
        else:
            step *= 0.5
            if abs(step) < SMALLEST_STEP:
                return None
    return x


def _spiral_guesses(straight: Array) -> list[Array]:
    """Guesses that roll and turn to both sides of a straight glide."""
    guesses = []
    for side in (-1.0, 1.0):
        for roll, turn_rate in ((10.0, 0.005), (30.0, 0.02), (60.0, 0.05)):
            guess = straight.copy()
            guess[3] = -side * math.radians(roll)
            guess[5] = side * turn_rate
            guesses.append(guess)
    return guesses


def _distinct_motions(
    problem: SteadyProblem, guesses: list[Array], linear_angle: float
) -> list[SteadyMotion]:
    """Distinct steady motions that follow from the guesses."""
    motions: list[SteadyMotion] = []
    for x in solve_steady_state(problem.residual, guesses):
        x[3:5] = [math.remainder(angle, math.tau) for angle in x[3:5]]
        if abs(x[4]) > math.pi / 2:
            continue  # other Euler angles of a motion that was found with a smaller pitch
        nu_r = problem.nu_r(x)
        if any(np.max(np.abs(nu_r - known.nu_r)) < DISTINCT_ROOTS for known in motions):
            continue  # an equal motion, whose angles differ by a full turn
        trim = Trim.from_motion(
            v_rel=x[:3], roll=x[3], pitch=x[4], turn_rate=x[5], linear_angle=linear_angle
        )
        eigenvalues = problem.eigenvalues(x)
        motions.append(SteadyMotion(trim=trim, nu_r=nu_r, eigenvalues=eigenvalues))
    return motions


def steady_motions(problem: SteadyProblem, linear_angle: float) -> list[SteadyMotion]:
    """Find all steady motions, stable ones first, then by the size of the angle of attack.

    Raises NoSteadyState when the net mass is zero or no motion is found.
    """
    if abs(problem.net_mass) < NEUTRAL and not problem.driven:
        raise NoSteadyState("net mass 0 kg: a neutrally buoyant vehicle has no force to move with")
    straight_problem = problem.with_rotation(0.0)
    straight = solve_steady_state(straight_problem.residual, straight_problem.straight_guesses())
    if problem.rotation == 0.0:
        guesses = straight + [g for x in straight for g in _spiral_guesses(x)]
    else:
        continued = [_continue_spiral(problem, x) for x in straight]
        guesses = [x for x in continued if x is not None]
        guesses += [g for x in straight for g in (x, *_spiral_guesses(x))]
    motions = _distinct_motions(problem, guesses, linear_angle)
    if not any(motion.stable and motion.forward for motion in motions):
        ends = [_settle(problem, x) for x in straight]
        guesses += [x for x in ends if x is not None]
        motions = _distinct_motions(problem, guesses, linear_angle)
    if not motions:
        raise NoSteadyState(
            f"no steady motion at {problem.request}, net mass {problem.net_mass:g} kg: "
            f"{problem.hint}"
        )
    motions.sort(key=lambda m: (not m.stable, abs(m.trim.angle_of_attack_deg)))
    return motions


def stable_motion(problem: SteadyProblem, linear_angle: float) -> SteadyMotion:
    """Find the stable forward motion with the smallest angle of attack; raises NoSteadyState."""
    motions = steady_motions(problem, linear_angle)
    for motion in motions:
        if motion.stable and motion.forward:
            return motion
    best = motions[0]
    growth = float(np.max(best.eigenvalues.real))
    fault = "flies tail first" if best.stable else f"grows by {growth:.3g} 1/s"
    raise NoSteadyState(
        f"no stable forward motion at {problem.request}, net mass {problem.net_mass:g} kg: the one "
        f"at pitch {best.trim.pitch_deg:.1f} deg, angle of attack "
        f"{best.trim.angle_of_attack_deg:.1f} deg {fault}; {problem.hint}"
    )
