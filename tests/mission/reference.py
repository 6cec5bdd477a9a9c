"""An independent mission integrator in NumPy and float64, with small steps cut at every event.

It shares no code with the compiled step: currents and seafloor are interpolated on their own longitude-latitude grids,
positions are carried in degrees on the ellipsoid, and every leg is walked. All members advance together, each with
its own step length.
"""

from __future__ import annotations

import numpy as np

A, E2 = 6378137.0, 6.69437999014e-3


def radii(latitude):
    """Metres per radian of latitude, and of longitude."""
    s = np.sin(np.radians(latitude))
    w = 1.0 - E2 * s * s
    return A * (1.0 - E2) / w**1.5, A / np.sqrt(w) * np.cos(np.radians(latitude))


class Grid:
    """Bilinear in space and linear in time on regular axes; ``values`` (time, lat, lon)."""

    def __init__(self, values, latitude, longitude, time=None):
        self.values, self.latitude, self.longitude, self.time = values, latitude, longitude, time

    def __call__(self, latitude, longitude, time=None):
        fy = (latitude - self.latitude[0]) / (self.latitude[1] - self.latitude[0])
        fx = (longitude - self.longitude[0]) / (self.longitude[1] - self.longitude[0])
        j = np.clip(np.floor(fy).astype(int), 0, self.latitude.size - 2)
        i = np.clip(np.floor(fx).astype(int), 0, self.longitude.size - 2)
        fy, fx = fy - j, fx - i

        def frame(k):
            v = self.values
            low = v[k, j, i] * (1 - fx) + v[k, j, i + 1] * fx
            high = v[k, j + 1, i] * (1 - fx) + v[k, j + 1, i + 1] * fx
            return low * (1 - fy) + high * fy

        if self.time is None:
            return frame(np.zeros_like(j))
        ft = (time - self.time[0]) / (self.time[1] - self.time[0])
        k = np.clip(np.floor(ft).astype(int), 0, self.time.size - 2)
        return frame(k) * (1 - (ft - k)) + frame(k + 1) * (ft - k)


def fly(*, n, start, t0, duration, waypoints, radius, yo, overshoot, stay, period, correction, speeds, heading, energy,
        east, north, floor, outputs, step=5.0):
    """Fly ``n`` members.

    Returns the surfacings (4, n, s) of time, latitude, longitude and energy, NaN padded, and the energy drawn by the
    times ``outputs`` (n, o), NaN once a member has ended.

    ``speeds`` (n, segments) m s-1; ``yo`` has dive_to, climb_to, altitude, tangent; ``stay`` (n,) s; ``heading`` (n,)
    rad, true minus believed; ``energy`` maps names to (n,) coefficients.
    """
    z = np.zeros(n)
    lat, lon = np.full(n, start[0]), np.full(n, start[1])
    dr_lat, dr_lon = lat.copy(), lon.copy()
    dac = np.zeros((2, n))
    t = np.full(n, float(t0))
    mode = np.zeros(n, int)  # 0 dive, 1 dive overshoot, 2 climb, 3 climb overshoot, 4 surface
    left = np.zeros(n)  # s left of an overshoot or a stay
    due = t + period
    dived = t.copy()
    leg, segment = np.zeros(n, int), np.zeros(n, int)
    up, over, done = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n, bool)
    spent = energy["climb_to_dive"] + energy["brake"]
    found = [[] for _ in range(n)]
    drawn = np.full((n, len(outputs)), np.nan)
    times = np.asarray(outputs, float)
    targets = np.array(waypoints)
    while True:
        live = ~over & (t < t0 + duration)
        if not live.any():
            break
        forward = speeds[np.arange(n), np.minimum(segment, speeds.shape[1] - 1)]
        w = forward * yo["tangent"]
        under = mode < 4
        # Bearing to the waypoint from where the glider believes it is.
        m, p = radii(dr_lat)
        de = np.radians(targets[leg, 1] - dr_lon) * p
        dn = np.radians(targets[leg, 0] - dr_lat) * m
        distance = np.hypot(de, dn)
        ue, un = de / distance, dn / distance
        across = correction * (dac[1] * ue - dac[0] * un)
        along = correction * (dac[0] * ue + dac[1] * un)
        sine = np.clip(-across / forward, -0.95, 0.95)
        cosine = np.sqrt(1 - sine**2)
        he, hn = ue * cosine - un * sine, un * cosine + ue * sine
        good = cosine * forward + along
        c, s = np.cos(heading), np.sin(heading)
        te, tn = he * c + hn * s, hn * c - he * s
        # The step ends at the first event of each member.
        turn = np.minimum(floor(lat, lon) - yo["altitude"], yo["dive_to"])
        dt = np.full(n, step)
        dt = np.where(mode == 0, np.minimum(dt, np.maximum(turn - z, 0) / w + 1e-3), dt)
        dt = np.where((mode == 1) | (mode == 3) | (mode == 4), np.minimum(dt, left), dt)
        goal = np.where(up, 0.0, yo["climb_to"])
        dt = np.where(mode == 2, np.minimum(dt, np.maximum(z - goal, 0) / w + 1e-6), dt)
        dt = np.where(under & (t < due), np.minimum(dt, due - t + 1e-6), dt)
        ahead = np.maximum(distance - radius, 0) / np.maximum(good, 1e-9) + 1e-3
        dt = np.where(under & (good > 0) & (distance > radius), np.minimum(dt, ahead), dt)
        dt = np.where(live, np.maximum(dt, 0.0), 0.0)
        # Midpoint rule.
        v = np.where(under, forward, 0.0)
        m, p = radii(lat)
        ce, cn = east(lat, lon, t), north(lat, lon, t)
        mlat = lat + np.degrees((v * tn + cn) * 0.5 * dt / m)
        mlon = lon + np.degrees((v * te + ce) * 0.5 * dt / p)
        ce, cn = east(mlat, mlon, t + 0.5 * dt), north(mlat, mlon, t + 0.5 * dt)
        m, p = radii(mlat)
        lat = lat + np.degrees((v * tn + cn) * dt / m)
        lon = lon + np.degrees((v * te + ce) * dt / p)
        m, p = radii(dr_lat)
        dr_lat = dr_lat + np.degrees(under * (v * hn + correction * dac[1]) * dt / m)
        dr_lon = dr_lon + np.degrees(under * (v * he + correction * dac[0]) * dt / p)
        z = z + np.where(mode <= 1, w, np.where(mode <= 3, -w, 0.0)) * dt
        z = np.maximum(z, 0.0)
        left = left - dt
        t = t + dt
        spent = spent + energy["hotel"] * dt
        k = np.searchsorted(times, t)
        passed = live & (k > 0) & (times[np.maximum(k, 1) - 1] > t - dt)
        back = energy["hotel"] * (t - times[np.maximum(k, 1) - 1])
        drawn[passed, k[passed] - 1] = (spent - back)[passed]
        # Events.
        m, p = radii(dr_lat)
        distance = np.hypot(np.radians(targets[leg, 1] - dr_lon) * p, np.radians(targets[leg, 0] - dr_lat) * m)
        hit = live & under & (distance <= radius + 1e-2)
        last = leg == len(targets) - 1
        finishes = hit & last
        done = done | finishes
        leg = np.where(hit & ~last, leg + 1, leg)
        up = up | (live & under & (t >= due)) | finishes
        turn = np.minimum(floor(lat, lon) - yo["altitude"], yo["dive_to"])
        begins = live & (mode == 0) & ((z >= turn - 1e-2) | up)
        mode = np.where(begins, 1, mode)
        left = np.where(begins, overshoot, left)
        turned = live & (mode == 1) & (left <= 1e-9) & ~begins
        spent = spent + turned * (energy["intercept"] + energy["slope"] * z + energy["brake"])
        mode = np.where(turned, 2, mode)
        tops = live & (mode == 2) & ~up & (z <= yo["climb_to"] + 1e-3) & ~turned
        lead = np.minimum(overshoot, 0.7 * yo["climb_to"] / w)
        mode, left = np.where(tops, 3, mode), np.where(tops, lead, left)
        again = live & (mode == 3) & (left <= 1e-9) & ~tops & ~up
        spent = spent + again * (energy["climb_to_dive"] + energy["brake"])
        mode = np.where(again, 0, mode)
        rises = live & (mode >= 2) & (mode < 4) & up & (z <= 1e-2)
        # A timer that runs out during the overshoot at the top sends the glider on up.
        mode = np.where(live & (mode == 3) & up & ~rises, 2, mode)
        for k in np.flatnonzero(rises):
            found[k].append((t[k], lat[k], lon[k], spent[k]))
        m, p = radii(dr_lat)
        age = np.maximum(t - dived, 60.0)
        new = np.stack([np.radians(lon - dr_lon) * p / age, np.radians(lat - dr_lat) * m / age])
        dac = np.where(rises, correction * dac + new, dac)
        over = over | (rises & done)
        mode, left = np.where(rises, 4, mode), np.where(rises, stay, left)
        due = np.where(rises, t + period, due)
        leaves = live & (mode == 4) & (left <= 1e-9) & ~rises
        mode = np.where(leaves, 0, mode)
        segment = segment + leaves
        spent = spent + leaves * (energy["climb_to_dive"] + energy["brake"])
        dived = np.where(leaves, t, dived)
        dr_lat, dr_lon = np.where(leaves, lat, dr_lat), np.where(leaves, lon, dr_lon)
        up = up & ~leaves
        z = np.where((mode == 4) | leaves, 0.0, z)
    most = max((len(f) for f in found), default=0)
    table = np.full((4, n, max(most, 1)), np.nan)
    for k, events in enumerate(found):
        for j, event in enumerate(events):
            table[:, k, j] = event
    return table, drawn

