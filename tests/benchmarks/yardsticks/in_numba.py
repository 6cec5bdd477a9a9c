"""The step in numba, one member after another in parallel: the same physics as mission.c and the forecaster's step.

Numba is no dependency of the package; :class:`NumbaStep` says so where it is absent. Every constant is wrapped in
``float32``, since a plain one would turn the arithmetic into double precision.
"""

from __future__ import annotations

import math

import numpy as np

from tests.benchmarks.yardsticks.arrays import FINAL, RECORD, Arrays, Flown

try:
    import numba
    from numba import njit, prange
except ImportError:
    numba = None

    def njit(*_, **__):
        """Leave the function as it is; it is then never called."""
        return lambda function: function

    prange = range

#: No promise that numbers are finite: NaN means outside.
FAST = {"contract", "nsz", "arcp"}
f = np.float32
u = np.uint32
ZERO, HALF, ONE, TWO, FAR, NAN = f(0.0), f(0.5), f(1.0), f(2.0), f(1e9), f(np.nan)
FLYING, ARRIVED, LEFT_AREA, LEFT_TIME, LEFT_FLOOR, AGROUND, STALLED, ABORTED, INVALID = 0, 1, 4, 5, 6, 7, 8, 9, 10
ROWS, ENDS = len(RECORD), len(FINAL)
ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
SINE = tuple(f((-1.0) ** k / math.factorial(2 * k + 1)) for k in range(7))
COSINE = tuple(f((-1.0) ** k / math.factorial(2 * k)) for k in range(7))


@njit(fastmath=FAST, error_model="numpy")
def _round(a, b, turn):
    a = u(a + b)
    b = u((b << u(turn)) | (b >> u(32 - turn)))
    return a, u(b ^ a)


@njit(fastmath=FAST, error_model="numpy")
def _words(k0, k1, counter, stream):
    """Threefry-2x32 with 13 rounds."""
    k2 = u(k0 ^ k1 ^ u(0x1BD11BDA))
    a, b = u(u(counter) + k0), u(u(stream) + k1)
    a, b = _round(a, b, 13)
    a, b = _round(a, b, 15)
    a, b = _round(a, b, 26)
    a, b = _round(a, b, 6)
    a, b = u(a + k1), u(u(b + k2) + u(1))
    a, b = _round(a, b, 17)
    a, b = _round(a, b, 29)
    a, b = _round(a, b, 16)
    a, b = _round(a, b, 24)
    a, b = u(a + k2), u(u(b + k0) + u(2))
    a, b = _round(a, b, 13)
    a, b = _round(a, b, 15)
    a, b = _round(a, b, 26)
    a, b = _round(a, b, 6)
    a, b = u(a + k0), u(u(b + k1) + u(3))
    return _round(a, b, 17)


@njit(fastmath=FAST, error_model="numpy")
def _uniform(word):
    return (f(word >> u(9)) + HALF) * f(1.0 / 8388608.0)


@njit(fastmath=FAST, error_model="numpy")
def _normals(k0, k1, counter, stream):
    a, b = _words(k0, k1, counter, stream)
    radius = math.sqrt(f(-2.0) * math.log(_uniform(a)))
    x = (_uniform(b) - HALF) * f(math.pi)
    y = x * x
    s, c = SINE[6], COSINE[6]
    for k in range(5, -1, -1):
        s, c = s * y + SINE[k], c * y + COSINE[k]
    s = s * x
    return radius * (TWO * s * s - ONE), radius * (f(-2.0) * s * c)


@njit(fastmath=FAST, error_model="numpy")
def _draw_speed(speeds, k0, k1, segment):
    a, _ = _words(k0, k1, segment, 1)
    place = _uniform(a) * f(speeds.size - 1)
    cell = min(max(int(place), 0), speeds.size - 2)
    low = speeds[cell]
    return low + (place - f(cell)) * (speeds[cell + 1] - low)


@njit(fastmath=FAST, error_model="numpy")
def _polynomial(plan, first, y):
    return (((plan[first + 4] * y + plan[first + 3]) * y + plan[first + 2]) * y + plan[first + 1]) * y + plan[first]


@njit(fastmath=FAST, error_model="numpy")
def _clip(x, low, high):
    return min(max(x, low), high)


@njit(fastmath=FAST, error_model="numpy")
def _steer(correction, east, north, speed, dac_east, dac_north):
    """Heading to a point so many metres away, the speed made good towards it, and its distance."""
    distance = math.sqrt(east * east + north * north)
    safe = max(distance, f(1e-3))
    de, dn = east / safe, north / safe
    along = correction * (dac_east * de + dac_north * dn)
    across = correction * (dac_north * de - dac_east * dn)
    sine = _clip(-across / speed, f(-0.95), f(0.95))
    cosine = math.sqrt(ONE - sine * sine)
    return de * cosine - dn * sine, dn * cosine + de * sine, cosine * speed + along, distance


@njit(fastmath=FAST, error_model="numpy")
def _depth_at(floor, places, counts, east, north):
    """Water depth and its slopes per frame metre; NaN outside."""
    fx, fy = (east - places[6]) * places[8], (north - places[7]) * places[9]
    i = min(max(int(np.floor(fx)), 0), counts[3] - 1)
    j = min(max(int(np.floor(fy)), 0), counts[4] - 1)
    fx, fy = fx - f(i), fy - f(j)
    row = floor[j * counts[3] + i]
    gx, gy = (row[1] + row[3] * fy) * places[8], (row[2] + row[3] * fx) * places[9]
    if fx < ZERO or fx > ONE or fy < ZERO or fy > ONE:
        return NAN, gx, gy
    return row[0] + row[1] * fx + row[2] * fy + row[3] * fx * fy, gx, gy


@njit(fastmath=FAST, error_model="numpy")
def _fly_member(
    plan, places, counts, currents, error, floor, speeds, points, member, k0, k1, code, outputs, records, ends
):
    """One member from start to end; ``records`` (output, row), ``ends`` (row)."""
    radius, dive_to, climb_to, altitude, dive_tan, climb_tan, lead, surface_stay, every, overtime = (
        plan[0], plan[1], plan[2], plan[3], plan[4], plan[5], plan[6], plan[7], plan[8], plan[9],
    )  # fmt: skip
    correction, interval, slot, minimum_yo, minimum_depth, error_time, error_length = (
        plan[10], plan[11], plan[12], plan[13], plan[14], plan[15], plan[16],
    )  # fmt: skip
    cosine_turn, sine_turn, stay, factor, pump, pump_per_metre, retract, brake, hotel, surface = (
        member[0], member[1], member[2], member[3], member[4], member[5], member[6], member[7], member[8], member[9],
    )  # fmt: skip
    power_dive, power_climb, power_surface, per_surfacing, per_inflection, limit = (
        member[10], member[11], member[12], member[13], member[14], member[15],
    )  # fmt: skip
    per_second, frames, cells, legs = places[5], counts[2], counts[0] * counts[1], counts[6]
    # As ensemble.initial_state.
    off_east, off_north = _normals(k0, k1, 0, 3)
    sx, sy = _polynomial(plan, 21, plan[19] / plan[20]), _polynomial(plan, 26, plan[19] / plan[20])
    east, north = plan[18] + plan[17] * off_east * sx, plan[19] + plan[17] * off_north * sy
    error_east, error_north = _normals(k0, k1, 1, 3)
    bottom, gx, gy = _depth_at(floor, places, counts, east, north)
    turn = dive_to if math.isnan(bottom) else _clip(bottom - altitude, minimum_yo, dive_to)
    dr_east, dr_north, dac_east, dac_north, depth = east, north, ZERO, ZERO, ZERO
    time, due, dive_clock, speed = ZERO, max(every, f(60.0)), ZERO, _draw_speed(speeds, k0, k1, 0)
    up, done, reason, leg, steps, outcome = False, False, 0, 0, 0, FLYING
    current_east, current_north, contacts, end_time = ZERO, ZERO, ZERO, NAN
    last_time, last_east, last_north, last_turn, last_top, last_dive, last_climb, last_up = (
        ONE, ZERO, ZERO, ZERO, ZERO, ONE, ONE, True,
    )  # fmt: skip
    arrival_0, arrival_1 = NAN, NAN
    pumped, retracted, braked, hotelled, sum_dive, sum_climb, sum_surface = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    inflections, surfacings, through, ground = ZERO, ZERO, ZERO, ZERO
    d_pumped, d_retracted, d_braked, d_hotelled, d_dive, d_climb, d_surface = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    d_inflections, d_surfacings, d_through, d_ground = ZERO, ZERO, ZERO, ZERO
    at_t, at_e, at_n, at_r = NAN, NAN, NAN, f(-1.0)
    was_t, was_e, was_n, was_r = NAN, NAN, NAN, f(-1.0)
    left_t, left_e, left_n, left_r = NAN, NAN, NAN, f(-1.0)
    gone_t, gone_e, gone_n, gone_r = NAN, NAN, NAN, f(-1.0)
    rate = interval * per_second
    begins = -places[4] * per_second
    for output in range(outputs):
        base = f(output) * interval
        part = begins - np.floor(begins) + (rate - np.floor(rate)) * f(output)
        clock = int(np.floor(begins)) + int(np.floor(rate)) * output + int(np.floor(part))
        part = part - np.floor(part)
        while outcome == FLYING and time < interval:
            # The step: dive.plan_dive, step._move, step._energies, step._verdict, step._advance.
            absolute = base + time
            y = north / plan[20]
            sx, sy = _polynomial(plan, 21, y), _polynomial(plan, 26, y)
            yos, comes, reached, contact, aground, no_bottom, stalled = ZERO, False, False, False, False, False, False
            forward, te, tn, he, hn, dive_time, climb_time, comes_up, arrival = (
                ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, False, FAR,
            )  # fmt: skip
            last_leg, why, new_turn, top = leg >= legs - 1, reason, turn, ZERO
            if up:
                duration = surface_stay * stay
            else:
                v = speed * factor
                down, climb = v * dive_tan, v * climb_tan
                per_down, per_climb = ONE / down, ONE / climb
                stalled = down <= f(0.005) or climb <= f(0.005)
                zp = max(turn, depth + minimum_yo)
                top = max(climb_to - climb * lead, f(0.3) * climb_to)
                started, top_down, top_climb = depth * per_down, top * per_down, top * per_climb
                first, cycle = zp * per_down - started, (zp - top) * (per_down + per_climb)
                he1, hn1, good, distance = _steer(
                    correction, (points[leg, 0] - dr_east) / sx, (points[leg, 1] - dr_north) / sy,
                    v, dac_east, dac_north,
                )  # fmt: skip
                if good > f(1e-3):
                    arrival = max(distance - radius, ZERO) / good
                remaining = due - time
                if last_leg and arrival < remaining:
                    comes_up, remaining, why = True, arrival, 3
                fit = np.floor((remaining - first - cycle) / cycle)
                until = slot * (np.floor(time / slot + HALF) + ONE) - time
                yos = _clip(min(f(np.rint(until / cycle)), fit), ONE, f(64.0))
                te1, tn1 = he1 * cosine_turn + hn1 * sine_turn, hn1 * cosine_turn - he1 * sine_turn
                ratio = per_down + HALF * (yos - ONE) * (per_down + per_climb)
                tau = first + HALF * (yos - ONE) * cycle - lead
                ve, vn = (v * te1 + current_east) * sx, (v * tn1 + current_north) * sy
                bottom, gx, gy = _depth_at(floor, places, counts, east + ve * tau, north + vn * tau)
                slope, over = _clip((gx * ve + gy * vn) * ratio, -HALF, HALF), down * lead
                wanted = (bottom - altitude + slope * (over - zp)) / (ONE - slope)
                least = max(depth, top) + minimum_yo
                new_turn = max(min(wanted, dive_to) + over, least)
                contact = new_turn > bottom - HALF
                if contact:
                    new_turn = bottom - HALF
                no_bottom = math.isnan(bottom)
                aground = bottom < minimum_depth or new_turn < top + HALF
                reach = depth + down * max(remaining, ZERO) + over
                breaks = (plan[32] if why == 3 else plan[31]) > HALF
                if yos < f(1.5) and reach < new_turn and breaks:
                    new_turn = max(reach, depth + HALF * minimum_yo)
                if aground or no_bottom:
                    new_turn = least
                low_down, low_climb = new_turn * per_down, new_turn * per_climb
                first_time, up_time, again = low_down - started, low_climb - top_climb, low_down - top_down
                comes = yos < f(1.5) and remaining <= first_time + (up_time if breaks else ZERO)
                climb_time = yos * up_time + (top_climb if comes else ZERO)
                dive_time = first_time + (yos - ONE) * again
                duration = dive_time + climb_time
                forward = v * duration
                reached = arrival < duration
                share = arrival / duration if reached and not comes_up else ONE
                he, hn = he1, hn1
                if share < ONE:
                    following = 0 if leg + 1 >= legs else leg + 1
                    from_east = dr_east + (v * he1 + correction * dac_east) * arrival * sx
                    from_north = dr_north + (v * hn1 + correction * dac_north) * arrival * sy
                    he2, hn2, good, distance = _steer(
                        correction, (points[following, 0] - from_east) / sx, (points[following, 1] - from_north) / sy,
                        v, dac_east, dac_north,
                    )  # fmt: skip
                    he, hn = share * he1 + (ONE - share) * he2, share * hn1 + (ONE - share) * hn2
                te, tn = he * cosine_turn + hn * sine_turn, hn * cosine_turn - he * sine_turn
            half = HALF * duration
            fx = (east + (HALF * forward * te + current_east * half) * sx - places[0]) * places[2]
            fy = (north + (HALF * forward * tn + current_north * half) * sy - places[1]) * places[3]
            i = min(max(int(np.floor(fx)), 0), counts[0] - 1)
            j = min(max(int(np.floor(fy)), 0), counts[1] - 1)
            fx, fy = fx - f(i), fy - f(j)
            cell = j * counts[0] + i
            dry = fx < ZERO or fx > ONE or fy < ZERO or fy > ONE
            frame_time = part + (time + half) * per_second
            whole = np.floor(frame_time)
            after, frame = frame_time - whole, clock + int(whole)
            if frame >= frames - 1:
                after = ONE
            frame = min(max(frame, 0), frames - 2)
            a, b = currents[frame * cells + cell], currents[(frame + 1) * cells + cell]
            fxy, prior = fx * fy, ONE - after
            wu = prior * (a[0] + a[1] * fx + a[2] * fy + a[3] * fxy) + after * (
                b[0] + b[1] * fx + b[2] * fy + b[3] * fxy
            )
            wv = prior * (a[4] + a[5] * fx + a[6] * fy + a[7] * fxy) + after * (
                b[4] + b[5] * fx + b[6] * fy + b[7] * fxy
            )
            dry = dry or math.isnan(wu)
            now = clock + int(np.floor(part + time * per_second))
            late = now < 0 or now >= frames - 1
            noise_east, noise_north = _normals(k0, k1, steps, 2)
            path = math.sqrt(wu * wu + wv * wv) * duration + forward
            memory = math.exp(-duration / error_time - path / error_length)
            kick = math.sqrt(max(ONE - memory * memory, ZERO))
            new_error_east = memory * error_east + kick * noise_east
            new_error_north = memory * error_north + kick * noise_north
            sd = HALF * error[cell]
            ce, cn = wu + sd * (error_east + new_error_east), wv + sd * (error_north + new_error_north)
            de, dn = forward * te + ce * duration, forward * tn + cn * duration
            new_east, new_north = east + de * sx, north + dn * sy
            n_pumped, n_retracted = yos * (pump + pump_per_metre * new_turn), yos * retract
            n_braked, n_hotelled = TWO * yos * brake, (hotel + (surface if up else ZERO)) * duration
            n_surface = duration if up else ZERO
            n_surfacings = ONE if comes else ZERO
            spent = (
                pumped + n_pumped + retracted + n_retracted + braked + n_braked + hotelled + n_hotelled
                + power_dive * (sum_dive + dive_time) + power_climb * (sum_climb + climb_time)
                + power_surface * (sum_surface + n_surface) + per_surfacing * (surfacings + n_surfacings)
                + per_inflection * (inflections + TWO * yos)
            )  # fmt: skip
            finishes = reached and last_leg
            verdict = ARRIVED if comes and (done or finishes) else FLYING
            if absolute + duration > overtime and verdict == FLYING:
                verdict = ABORTED
            if spent > limit:
                verdict = code
            stuck = FLYING if math.isfinite(new_east + new_north + duration + spent) else INVALID
            if dry:
                stuck = LEFT_AREA
            if late:
                stuck = LEFT_TIME
            if aground:
                stuck = AGROUND
            if no_bottom:
                stuck = LEFT_FLOOR
            if stalled:
                stuck = STALLED
            if stuck != FLYING:
                outcome, end_time = stuck, absolute
                break
            end = absolute + duration
            outcome, end_time = verdict, end
            last_time, last_east, last_north, last_up = duration, new_east - east, new_north - north, up
            d_pumped, d_retracted, d_braked, d_hotelled = n_pumped, n_retracted, n_braked, n_hotelled
            d_dive, d_climb, d_surface, d_inflections = dive_time, climb_time, n_surface, TWO * yos
            d_surfacings, d_through, d_ground = n_surfacings, forward, math.sqrt(de * de + dn * dn)
            if up:
                under = max(absolute - dive_clock, f(60.0))
                dac_east = correction * dac_east + (east - dr_east) / sx / under
                dac_north = correction * dac_north + (north - dr_north) / sy / under
                dr_east, dr_north, depth, dive_clock = new_east, new_north, ZERO, end
                due, reason = max(time + every, time + duration + f(60.0)), 0
                speed = _draw_speed(speeds, k0, k1, int(surfacings))
                last_turn, last_top = ZERO, ZERO
                gone_t, gone_e, gone_n, gone_r = left_t, left_e, left_n, left_r
                left_t, left_e, left_n, left_r = end, new_east, new_north, f(why)
                up = False
            else:
                dr_east = dr_east + (forward * he + correction * dac_east * duration) * sx
                dr_north = dr_north + (forward * hn + correction * dac_north * duration) * sy
                last_turn, last_dive, last_climb = new_turn, dive_time / yos, climb_time / yos
                last_top = depth = ZERO if comes else top
                if contact:
                    contacts = contacts + yos
                if reached:
                    arrived = absolute + (duration if comes_up else arrival)
                    if leg == 0 and math.isnan(arrival_0):
                        arrival_0 = arrived
                    if leg == 1 and math.isnan(arrival_1):
                        arrival_1 = arrived
                    done = done or finishes
                    leg = min(leg + 1, legs - 1)
                if comes:
                    was_t, was_e, was_n, was_r = at_t, at_e, at_n, at_r
                    at_t, at_e, at_n, at_r = end, new_east, new_north, f(why)
                    up = True
                else:
                    turn = new_turn
            east, north, current_east, current_north = new_east, new_north, ce, cn
            error_east, error_north = new_error_east, new_error_north
            pumped, retracted = pumped + d_pumped, retracted + d_retracted
            braked, hotelled = braked + d_braked, hotelled + d_hotelled
            sum_dive, sum_climb, sum_surface = sum_dive + d_dive, sum_climb + d_climb, sum_surface + d_surface
            inflections, surfacings = inflections + d_inflections, surfacings + d_surfacings
            through, ground = through + d_through, ground + d_ground
            steps += 1
            time = time + duration
        # The record, as ensemble._output.
        back = max(time - interval, ZERO)
        share = _clip(back / last_time, ZERO, ONE)
        rest = back if back < last_climb else back % (last_dive + last_climb)
        rising = rest < last_climb
        if rising:
            z = last_top + (last_turn - last_top) * rest / max(last_climb, ONE)
        else:
            z = last_turn - (last_turn - last_top) * ((rest - last_climb) / max(last_dive, ONE))
        flying = outcome == FLYING or end_time > base + interval
        to = records[output]
        to[0], to[1] = east - share * last_east, north - share * last_north
        to[2] = max(z, ZERO) if flying and not last_up else ZERO
        to[3] = f(3.0) if last_up or not flying else (ONE if rising else TWO)
        to[4], to[5], to[6] = ONE if flying else ZERO, current_east, current_north
        to[7], to[8] = pumped - share * d_pumped, retracted - share * d_retracted
        to[9], to[10] = braked - share * d_braked, hotelled - share * d_hotelled
        to[11], to[12], to[13] = sum_dive - share * d_dive, sum_climb - share * d_climb, sum_surface - share * d_surface
        to[14], to[15] = inflections - share * d_inflections, surfacings - share * d_surfacings
        to[16], to[17] = through - share * d_through, ground - share * d_ground
        to[18], to[19], to[20], to[21] = at_t, at_e, at_n, at_r
        to[22], to[23], to[24], to[25] = was_t, was_e, was_n, was_r
        to[26], to[27], to[28], to[29] = left_t, left_e, left_n, left_r
        to[30], to[31], to[32], to[33] = gone_t, gone_e, gone_n, gone_r
        time, due = time - interval, due - interval
    ends[0], ends[1], ends[2], ends[3], ends[4], ends[5] = outcome, steps, contacts, end_time, arrival_0, arrival_1


@njit(parallel=True, fastmath=FAST, error_model="numpy")
def _fly(plan, places, counts, currents, error, floor, speeds, points, member, keys, codes, outputs, records, ends):
    for m in prange(codes.size):
        _fly_member(
            plan, places, counts, currents, error, floor, speeds, points, member[m], keys[m, 0], keys[m, 1], codes[m],
            outputs, records[m], ends[m],
        )  # fmt: skip


class NumbaStep:
    """The compiled step; ``reason`` says why there is none. Its first flight compiles."""

    name = "numba"

    def __init__(self):
        self.reason = "" if numba is not None else "numba is not installed"
        self.version = "" if numba is None else f"numba {numba.__version__}"
        self._records = np.empty((0,), np.float32)

    def fly(self, given: Arrays, threads: int) -> Flown:
        """Fly all members; the records are overwritten by the next flight."""
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        count = given.codes.size
        if self._records.shape != (count, given.outputs, ROWS):
            self._records = np.zeros((count, given.outputs, ROWS), np.float32)
        ends = np.zeros((count, ENDS), np.float32)
        _fly(
            given.plan, given.places, given.counts, given.currents, given.error, given.floor, given.speeds,
            given.waypoints, np.ascontiguousarray(given.member.T), np.ascontiguousarray(given.keys.T), given.codes,
            given.outputs, self._records, ends,
        )  # fmt: skip
        return Flown(self._records.transpose(1, 2, 0), ends.T)
