"""Kernels: compiled loops of the sensors, for recursions in time and for small arrays.

Vectors are contiguous float64 of shape (n,) on the mission's time grid; normals are float32.
"""

from __future__ import annotations

import math

import numpy as np

from twin.compiled import jit
from twin.water.floor.lookup import beam_length, shallowest_depth

DEG = math.pi / 180.0
BEAMS = 4
NO_LOCK, BOTTOM_LOCK, WATER_LOCK = 0, 1, 2
MIN_BEAMS = 3
"""Minimum number of beams for a three-dimensional velocity."""
LEAST_COSINE = 0.05
"""Lower bound of cos(pitch): above 87 deg, roll and heading have no useful meaning."""


@jit
def gauss_markov_kernel(white, std, decay, stride, out):  # type: ignore[no-untyped-def]
    """Fill `out` with a stationary first-order Gauss-Markov process, linear between its knots.

    white: one standard normal per knot; decay: from knot to knot; stride: samples per knot.
    """
    step = std * math.sqrt(1.0 - decay * decay)
    n = out.shape[0]
    state = std * white[0]
    for j in range(white.shape[0] - 1):
        following = decay * state + step * white[j + 1]
        slope = (following - state) / stride
        first = j * stride
        for k in range(first, min(first + stride, n)):
            out[k] = state + slope * (k - first)
        state = following


@jit
def slow_kernel(bias, knots, bias_std, decay, walk_step, slow):  # type: ignore[no-untyped-def]
    """Fill `slow`, (3, m), with bias[i] + Gauss-Markov process + random walk at the knots.

    knots: standard normals (3, 2, m) that drive the two processes.
    """
    step = bias_std * math.sqrt(1.0 - decay * decay)
    for i in range(3):
        state = bias_std * knots[i, 0, 0]
        walk = bias[i]
        slow[i, 0] = state + walk
        for j in range(1, knots.shape[2]):
            state = decay * state + step * knots[i, 0, j]
            walk = walk + walk_step * knots[i, 1, j]
            slow[i, j] = state + walk


@jit
def triad_kernel(x, y, z, matrix, white, white_std, slow, stride, begin, out):  # type: ignore[no-untyped-def]
    """Fill `out[i]`, (3, stretch), with matrix[i] @ (x, y, z) + slow errors + white noise.

    x, y, z: samples from `begin` on. white: standard normals (3, n) of the whole mission. slow:
    slow errors of the whole mission with a knot every `stride` samples, linear in between.
    """
    n = x.shape[0]
    for i in range(3):
        a, b, c = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        for j in range(begin // stride, (begin + n - 1) // stride + 1):
            slope = (slow[i, j + 1] - slow[i, j]) / stride
            first = j * stride
            for k in range(max(first, begin), min(first + stride, begin + n)):
                m = k - begin
                out[i, m] = (
                    a * x[m] + b * y[m] + c * z[m]
                    + slow[i, j] + slope * (k - first) + white_std * white[i, k]
                )  # fmt: skip


@jit
def complementary_kernel(rate, reference, dt, time_constant, carried, out):  # type: ignore[no-untyped-def]
    """Error of a complementary filter: out' = rate - (out - reference) / time_constant.

    rate: error of the angle's rate from the gyros; reference: error of the angle from gravity or
    the compass, shape (n,). Backward Euler, stable for every step. carried: (1,) error at the
    sample before; NaN at the first sample, where the filter has settled.
    """
    error = carried[0]
    if error != error:
        error = reference[0] + time_constant * rate[0]
    share = dt / time_constant
    for k in range(out.shape[0]):
        error = (error + dt * rate[k] + share * reference[k]) / (1.0 + share)
        out[k] = error
    carried[0] = error


@jit
def tilt_kernel(roll, pitch, force, gyro, rate, reference):  # type: ignore[no-untyped-def]
    """Errors of roll and pitch and of their rates, from accelerometer and gyros.

    roll, pitch: true [deg], (n,). force: measured specific force [m/s2], (3, n), assumed to be
    -gravity: roll = atan2(-f_y, -f_z), pitch = atan2(f_x, |f_y, f_z|). gyro: error of the measured
    rates [rad/s], (3, n). rate [deg/s] and reference [deg]: (2, n), roll and pitch. Near the
    vertical, where roll has no meaning, its errors are kept finite.
    """
    for k in range(roll.shape[0]):
        sin_r, cos_r = math.sin(roll[k] * DEG), math.cos(roll[k] * DEG)
        sin_p = math.sin(pitch[k] * DEG)
        cos_p = max(math.cos(pitch[k] * DEG), LEAST_COSINE)
        across = math.hypot(force[1, k], force[2, k])
        by_roll = math.atan2(-force[1, k], -force[2, k]) / DEG - roll[k]
        reference[0, k] = (by_roll + 180.0) % 360.0 - 180.0 if cos_p > LEAST_COSINE else 0.0
        reference[1, k] = math.atan2(force[0, k], across) / DEG - pitch[k]
        turning = sin_r * gyro[1, k] + cos_r * gyro[2, k]
        rate[0, k] = (gyro[0, k] + turning * sin_p / cos_p) / DEG
        rate[1, k] = (cos_r * gyro[1, k] - sin_r * gyro[2, k]) / DEG


@jit
def turn_kernel(roll, pitch, gyro_y, gyro_z, rate):  # type: ignore[no-untyped-def]
    """Error of the heading's rate [deg/s] from the gyros' errors [rad/s]; angles [deg]."""
    for k in range(rate.shape[0]):
        turning = math.sin(roll[k] * DEG) * gyro_y[k] + math.cos(roll[k] * DEG) * gyro_z[k]
        rate[k] = turning / max(math.cos(pitch[k] * DEG), LEAST_COSINE) / DEG


@jit
def thermal_kernel(  # type: ignore[no-untyped-def]
    temperature, dt, lag, amplitude, time_constant, carried, thermistor, cell
):
    """Temperatures of a CTD's thermistor and of the water in its conductivity cell.

    thermistor: first-order lag [s] behind the water. cell: the water's temperature minus the
    anomaly by the cell's wall (recursion of Lueck and Picklo, 1990). All (n,) [deg C]. carried:
    (3,) water, thermistor and anomaly at the previous sample, NaN at the first.
    """
    kept = math.exp(-dt / lag) if lag > 0.0 else 0.0
    a = 2.0 * amplitude * time_constant / dt / (1.0 + 2.0 * time_constant / dt)
    b = 1.0 - 2.0 * a / amplitude if amplitude > 0.0 else 0.0
    before, shown, anomaly = carried[0], carried[1], carried[2]
    for k in range(temperature.shape[0]):
        if before != before:
            shown, anomaly = temperature[k], 0.0
        else:
            shown = kept * shown + (1.0 - kept) * temperature[k]
            anomaly = a * (temperature[k] - before) - b * anomaly
        before = temperature[k]
        thermistor[k] = shown
        cell[k] = before - anomaly
    carried[0], carried[1], carried[2] = before, shown, anomaly


@jit
def compass_kernel(  # type: ignore[no-untyped-def]
    roll, pitch, heading, level_roll, level_pitch, shift, rotation, hard_iron, soft_iron, battery,
    distance, dip_tangent, offset, out,
):  # fmt: skip
    """Error of the heading [deg] from the magnetic vector soft_iron R^T m_n + hard iron.

    m_n = (1, 0, dip_tangent), in units of the horizontal field. Angles [deg] in, shift [m].
    level_roll, level_pitch: angles that level the vector. hard_iron: (3,) at the neutral battery
    position. battery: (3,) the battery's part of that field; it turns with the rotation and falls
    with the cube of the distance [m]. offset [rad] is added.
    """
    for k in range(out.shape[0]):
        sin_r, cos_r = math.sin(roll[k] * DEG), math.cos(roll[k] * DEG)
        sin_p, cos_p = math.sin(pitch[k] * DEG), math.cos(pitch[k] * DEG)
        sin_h, cos_h = math.sin(heading[k] * DEG), math.cos(heading[k] * DEG)
        sin_g, cos_g = math.sin(rotation[k] * DEG), math.cos(rotation[k] * DEG)
        ratio = distance / (distance + shift[k])
        fall = ratio * ratio * ratio
        bx = hard_iron[0] + (fall - 1.0) * battery[0]
        by = hard_iron[1] + fall * (cos_g * battery[1] - sin_g * battery[2]) - battery[1]
        bz = hard_iron[2] + fall * (sin_g * battery[1] + cos_g * battery[2]) - battery[2]
        # Earth's field in body axes
        x = cos_p * cos_h - sin_p * dip_tangent
        z = sin_p * cos_h + cos_p * dip_tangent
        y = -cos_r * sin_h + sin_r * z
        z = sin_r * sin_h + cos_r * z
        mx = x + soft_iron[0, 0] * x + soft_iron[0, 1] * y + soft_iron[0, 2] * z + bx
        my = y + soft_iron[1, 0] * x + soft_iron[1, 1] * y + soft_iron[1, 2] * z + by
        mz = z + soft_iron[2, 0] * x + soft_iron[2, 1] * y + soft_iron[2, 2] * z + bz
        # tilt compensation, then the angle between the level vector and the true heading's
        sin_r, cos_r = math.sin(level_roll[k] * DEG), math.cos(level_roll[k] * DEG)
        sin_p, cos_p = math.sin(level_pitch[k] * DEG), math.cos(level_pitch[k] * DEG)
        level_y = cos_r * my - sin_r * mz
        level_x = cos_p * mx + sin_p * (sin_r * my + cos_r * mz)
        cross = -cos_h * level_y - sin_h * level_x
        dot = cos_h * level_x - sin_h * level_y
        out[k] = (math.atan2(cross, dot) + offset) / DEG


@jit
def body_kernel(  # type: ignore[no-untyped-def]
    roll, pitch, heading, north, east, down, velocity, plumb
):
    """Fill `velocity` with R^T (north, east, down), body FRD, and `plumb` with R^T (0, 0, 1).

    Shapes (3, n). Angles [deg], velocity over ground [m/s].
    """
    for k in range(roll.shape[0]):
        sin_r, cos_r = math.sin(roll[k] * DEG), math.cos(roll[k] * DEG)
        sin_p, cos_p = math.sin(pitch[k] * DEG), math.cos(pitch[k] * DEG)
        sin_h, cos_h = math.sin(heading[k] * DEG), math.cos(heading[k] * DEG)
        ahead = cos_h * north[k] + sin_h * east[k]
        across = -sin_h * north[k] + cos_h * east[k]
        below = sin_p * ahead + cos_p * down[k]
        velocity[0, k] = cos_p * ahead - sin_p * down[k]
        velocity[1, k] = cos_r * across + sin_r * below
        velocity[2, k] = -sin_r * across + cos_r * below
        plumb[0, k] = -sin_p
        plumb[1, k] = sin_r * cos_p
        plumb[2, k] = cos_r * cos_p


@jit
def level_slant_kernel(plumb, depth, bottom_depth, lever, beams, slant):  # type: ignore[no-untyped-def]
    """Distance [m] along each beam from the instrument to a level bottom: slant, (4, n).

    plumb: (3, n). depth, bottom_depth: (n,) [m]. lever: (3,) [m] and beams: (4, 3), body FRD.
    inf for a beam that does not look down.
    """
    for k in range(depth.shape[0]):
        altitude = bottom_depth[k] - depth[k]
        for i in range(3):
            altitude -= lever[i] * plumb[i, k]
        for i in range(BEAMS):
            cosine = (
                beams[i, 0] * plumb[0, k] + beams[i, 1] * plumb[1, k] + beams[i, 2] * plumb[2, k]
            )
            slant[i, k] = altitude / cosine if cosine > 0.0 else math.inf


@jit
def slant_kernel(  # type: ignore[no-untyped-def]
    table, north, east, depth, roll, pitch, heading, lever, beams, farthest, step, slant
):
    """Distance [m] along each beam from the instrument to the sea floor: slant, (4, n).

    table: the compiled sea floor. north, east, depth: (n,) [m] of the CB; angles (n,) [deg].
    lever: (3,) [m] and beams: (4, 3), body FRD. inf beyond `farthest` [m] and for a beam that does
    not look down. `step` [m]: step of the search, see `beam_length`.
    """
    toward = np.empty(3)
    least = shallowest_depth(table)
    for k in range(depth.shape[0]):
        sin_r, cos_r = math.sin(roll[k] * DEG), math.cos(roll[k] * DEG)
        sin_p, cos_p = math.sin(pitch[k] * DEG), math.cos(pitch[k] * DEG)
        sin_h, cos_h = math.sin(heading[k] * DEG), math.cos(heading[k] * DEG)
        ahead, beside, below = lever[0], lever[1], lever[2]
        for i in range(BEAMS + 1):
            # the lever arm first, then the beams, from body axes to NED
            across = cos_r * beside - sin_r * below
            plumb = sin_r * beside + cos_r * below
            level = cos_p * ahead + sin_p * plumb
            toward[0] = cos_h * level - sin_h * across
            toward[1] = sin_h * level + cos_h * across
            toward[2] = -sin_p * ahead + cos_p * plumb
            if i == 0:
                x, y, z = north[k] + toward[0], east[k] + toward[1], depth[k] + toward[2]
            elif toward[2] > 0.0:
                slant[i - 1, k] = beam_length(table, least, x, y, z, toward, farthest, step)
            else:
                slant[i - 1, k] = math.inf
            if i < BEAMS:
                ahead, beside, below = beams[i, 0], beams[i, 1], beams[i, 2]


@jit
def dvl_kernel(  # type: ignore[no-untyped-def]
    ground, water, rates, plumb, depth, slant, lever, beams, solve, ping_step, locked,
    factor, bottom_std, water_std, white, outlier, outlier_beam, min_range, max_range, min_cosine,
    cell_reach, first, begin, end, velocity, mode,
):  # fmt: skip
    """Velocity at the instrument [m/s], body FRD, (3, m), and mode (m,), from single pings.

    ground, water, rates, plumb: (3, m) body velocity over ground and through the cell layer,
    angular velocity and plumb line. depth (m,) [m]; slant (4, m) [m] from the instrument to the
    bottom along each beam. These arrays begin at the mission's sample `first`; their samples begin
    to end - 1 are measured. beams: (4, 3) unit vectors; solve: (16, 3, 4) least-squares inverses by
    the set of beams. ping_step: samples from ping to ping. Per ping of the mission: locked, bool;
    outlier [m/s], 0 none, NaN if the beam reports its neighbour's velocity; and outlier_beam.
    white: standard normals (n, 4) of the mission. cell_reach [m]: slant range of the farthest water
    cell. The lock is decided at each sample, and the reading is the mean over the sample's pings.
    """
    n = depth.shape[0]
    pings = locked.shape[0]
    radial = np.empty(BEAMS)
    ping = max(0, int((first + begin - 0.5) / ping_step) - 1)
    while ping < pings and ping * ping_step < first + begin - 0.5:
        ping += 1
    for k in range(begin, end):
        # Which beams see the bottom, and which have their cells in the water.
        z = depth[k]
        for i in range(3):
            z += lever[i] * plumb[i, k]
        bottom_set = 0
        bottom_count = 0
        water_set = 0
        water_count = 0
        for i in range(BEAMS):
            cosine = (
                beams[i, 0] * plumb[0, k] + beams[i, 1] * plumb[1, k] + beams[i, 2] * plumb[2, k]
            )
            if cosine > min_cosine and min_range <= slant[i, k] <= max_range:
                bottom_set |= 1 << i
                bottom_count += 1
            if -z < cell_reach * cosine and cell_reach < slant[i, k]:
                water_set |= 1 << i
                water_count += 1
        kind = NO_LOCK
        used = 0
        std = 0.0
        source = ground
        if z > 0.0 and bottom_count >= MIN_BEAMS:
            kind = BOTTOM_LOCK
            used = bottom_set
            std = bottom_std
        elif z > 0.0 and water_count >= MIN_BEAMS:
            kind = WATER_LOCK
            used = water_set
            std = water_std
            source = water
        count = 0
        sum_x = 0.0
        sum_y = 0.0
        sum_z = 0.0
        radial[:] = 0.0
        while ping < pings and ping * ping_step < first + k + 0.5:
            now = ping
            ping += 1
            if kind == NO_LOCK or not locked[now]:
                continue
            # between samples the body-frame vectors are linear in time
            a = min(int(now * ping_step) - first, n - 1)
            f = now * ping_step - first - a
            b = min(a + 1, n - 1)
            wx = rates[0, a] + f * (rates[0, b] - rates[0, a])
            wy = rates[1, a] + f * (rates[1, b] - rates[1, a])
            wz = rates[2, a] + f * (rates[2, b] - rates[2, a])
            ux = source[0, a] + f * (source[0, b] - source[0, a]) + wy * lever[2] - wz * lever[1]
            uy = source[1, a] + f * (source[1, b] - source[1, a]) + wz * lever[0] - wx * lever[2]
            uz = source[2, a] + f * (source[2, b] - source[2, a]) + wx * lever[1] - wy * lever[0]
            sum_x += ux
            sum_y += uy
            sum_z += uz
            count += 1
            wrong = outlier[now]
            if wrong != 0.0:
                i = outlier_beam[now]
                if wrong != wrong:
                    m = (i + 1) % BEAMS
                    wrong = factor * (
                        (beams[m, 0] - beams[i, 0]) * ux
                        + (beams[m, 1] - beams[i, 1]) * uy
                        + (beams[m, 2] - beams[i, 2]) * uz
                    )
                radial[i] += wrong
        if count > 0:
            mode[k] = kind
            # the mean of `count` independent pings has 1/sqrt(count) of one ping's noise
            std /= math.sqrt(count)
            for i in range(BEAMS):
                along = beams[i, 0] * sum_x + beams[i, 1] * sum_y + beams[i, 2] * sum_z
                radial[i] = (along * factor + radial[i]) / count + std * white[first + k, i]
            for i in range(3):
                total = 0.0
                for m in range(BEAMS):
                    total += solve[used, i, m] * radial[m]
                velocity[i, k] = total
        else:
            mode[k] = NO_LOCK
            velocity[:, k] = np.nan


@jit
def onboard_kernel(  # type: ignore[no-untyped-def]
    depth, pitch, heading, gps_north, gps_east, dt, window, angle_of_attack, min_pitch,
    surface_depth, max_speed, min_dive_time, use_current, carried, begin, out,
):  # fmt: skip
    """Dead reckoning of `twin.sensors.onboard`; out: (4, m) north, east, current n, e.

    Measured depth [m], pitch and heading [deg], GPS [m] with NaN where there is no fix, (n,);
    window in samples; angles of the settings [rad], speeds [m/s], times [s]. out holds the samples
    from `begin` on; carried: (7,), zeros at the first sample.
    """
    north, east, current_n, current_e = carried[0], carried[1], carried[2], carried[3]
    speed, since_fix, pitch_sum = carried[4], carried[5], carried[6]
    for k in range(begin, begin + out.shape[1]):
        if k > 0:
            since_fix += dt
        pitch_sum += pitch[k]
        if k > window:
            pitch_sum -= pitch[k - window - 1]
        first = max(0, k - window)
        if k > 0:
            if depth[k] <= surface_depth:
                speed = 0.0
            else:
                rate = (depth[k] - depth[first]) / ((k - first) * dt)
                mean_pitch = pitch_sum / (k - first + 1) * DEG
                if abs(mean_pitch) >= min_pitch and rate * mean_pitch < 0.0:
                    path = min(abs(mean_pitch) + angle_of_attack, 0.5 * math.pi)
                    speed = min(abs(rate) / math.tan(path), max_speed)
            drift_n = current_n if use_current else 0.0
            drift_e = current_e if use_current else 0.0
            angle = heading[k] * DEG
            north += (speed * math.cos(angle) + drift_n) * dt
            east += (speed * math.sin(angle) + drift_e) * dt
        if gps_north[k] == gps_north[k]:
            if since_fix >= min_dive_time:
                drift_n = current_n if use_current else 0.0
                drift_e = current_e if use_current else 0.0
                current_n = drift_n + (gps_north[k] - north) / since_fix
                current_e = drift_e + (gps_east[k] - east) / since_fix
            north, east = gps_north[k], gps_east[k]
            since_fix = 0.0
        out[0, k - begin] = north
        out[1, k - begin] = east
        out[2, k - begin] = current_n
        out[3, k - begin] = current_e
    carried[0], carried[1], carried[2], carried[3] = north, east, current_n, current_e
    carried[4], carried[5], carried[6] = speed, since_fix, pitch_sum


@jit
def dvl_track_kernel(  # type: ignore[no-untyped-def]
    velocity_north, velocity_east, mode, gps_north, gps_east, dt, min_dive_time, use_current,
    carried, begin, out,
):  # fmt: skip
    """Dead reckoning of `twin.sensors.onboard` by a Doppler log; out: (4, m) as `onboard_kernel`.

    Measured velocity [m/s] NED and mode of its lock, (m,), GPS [m] with NaN where there is no fix,
    for the samples from `begin` on; carried: (8,), zeros at the first sample.
    """
    north, east, current_n, current_e = carried[0], carried[1], carried[2], carried[3]
    speed_n, speed_e, water_time, in_water = carried[4], carried[5], carried[6], carried[7]
    for k in range(mode.shape[0]):
        if mode[k] != NO_LOCK:
            speed_n, speed_e = velocity_north[k], velocity_east[k]
            in_water = 1.0 if mode[k] == WATER_LOCK else 0.0
        if begin + k > 0:
            north += speed_n * dt
            east += speed_e * dt
            if in_water != 0.0:
                water_time += dt
                if use_current:
                    north += current_n * dt
                    east += current_e * dt
        if gps_north[k] == gps_north[k]:
            if water_time >= min_dive_time:
                drift_n = current_n if use_current else 0.0
                drift_e = current_e if use_current else 0.0
                current_n = drift_n + (gps_north[k] - north) / water_time
                current_e = drift_e + (gps_east[k] - east) / water_time
            north, east = gps_north[k], gps_east[k]
            water_time = 0.0
        out[0, k] = north
        out[1, k] = east
        out[2, k] = current_n
        out[3, k] = current_e
    carried[0], carried[1], carried[2], carried[3] = north, east, current_n, current_e
    carried[4], carried[5], carried[6], carried[7] = speed_n, speed_e, water_time, in_water
