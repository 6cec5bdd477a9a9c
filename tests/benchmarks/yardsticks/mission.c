/* The bundled mission's step in C, written against the same physics as glider_jax/mission/step.py and dive.py.

   A yardstick, not a product: one surfacing rule ("every"), a list of waypoints flown once, constant legs, a surface
   current. Members are flown sixteen side by side, so that the compiler can use vector instructions; each thread
   takes its share of the members through one output interval after the other. Numbers are those of the prepared run
   (see arrays.py, which fills the structs); NaN in a table means outside, as there. */
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>

#define W 16
#define CLIP(x, low, high) MIN(MAX(x, low), high)
#define FAR 1e9f

static inline float MIN(float a, float b) { return a < b ? a : b; }
static inline float MAX(float a, float b) { return a > b ? a : b; }
static inline int32_t within(int32_t i, int32_t last) { i = i < 0 ? 0 : i; return i > last ? last : i; }

/* Numbers of the plan, in the order of arrays.PLAN. */
typedef struct {
    float radius, dive_to, climb_to, altitude, dive_tangent, climb_tangent, overshoot_time, surface_stay, every, overtime,
        correction, interval, slot, minimum_yo, minimum_depth, error_time, error_length, fix_sd, start_east, start_north,
        half_height, stretch_east[5], stretch_north[5], breaks_every, breaks_done, breaks_waypoint;
} Plan;

/* Grids, in the order of arrays.Grids: coefficients per cell, and where the cells lie. */
typedef struct {
    const float *currents, *error, *floor, *speeds, *waypoints;
    float x0, y0, dx, dy, first, per_second, floor_x0, floor_y0, floor_dx, floor_dy;
    int32_t nx, ny, frames, floor_nx, floor_ny, nodes, legs;
} Grids;

/* Outcomes, numbered as in errors.Outcome. */
enum { FLYING, ARRIVED, LEFT_AREA = 4, LEFT_TIME, LEFT_FLOOR, AGROUND, STALLED, ABORTED, INVALID };

/* What distinguishes a member, in the order of arrays.MEMBER; then its two key words and the code of its limit. */
#define MEMBER(X) \
    X(cosine) X(sine) X(stay) X(speed) X(pump) X(pump_per_metre) X(retract) X(brake) X(hotel) X(surface) \
    X(power_dive) X(power_climb) X(power_surface) X(per_surfacing) X(per_inflection) X(limit)
/* The state, and what one record needs of the step just made. */
#define SUMS(X) \
    X(pumped) X(retracted) X(braked) X(hotelled) X(dive_time) X(climb_time) X(surface_time) X(inflections) \
    X(surfacings) X(through_water) X(over_ground)
#define STATE(X) \
    X(time) X(east) X(north) X(dr_east) X(dr_north) X(dac_east) X(dac_north) X(depth) X(turn) X(due) X(dive_clock) \
    X(segment_speed) X(error_east) X(error_north) X(current_east) X(current_north) \
    X(last_time) X(last_east) X(last_north) X(last_turn) X(last_top) X(last_dive) X(last_climb) X(contacts) X(end_time) \
    X(arrival_0) X(arrival_1) \
    X(surfaced_time) X(surfaced_east) X(surfaced_north) X(surfaced_reason) \
    X(before_time) X(before_east) X(before_north) X(before_reason) \
    X(left_time) X(left_east) X(left_north) X(left_reason) \
    X(leftbefore_time) X(leftbefore_east) X(leftbefore_north) X(leftbefore_reason)
#define FLOAT(name) float name[W];
#define DELTA(name) float d_##name[W];

typedef struct {
    MEMBER(FLOAT) STATE(FLOAT) SUMS(FLOAT) SUMS(DELTA)
    uint32_t key0[W], key1[W];
    int32_t limit_code[W], up[W], last_up[W], reason[W], leg[W], done[W], outcome[W], steps[W];
} __attribute__((aligned(64))) Block;

static inline float uniform(uint32_t word) { return ((float)(int32_t)(word >> 9) + 0.5f) * (1.0f / 8388608.0f); }

/* Threefry-2x32 with 13 rounds. */
#define ROUND(turn) a += b; b = (b << turn) | (b >> (32 - turn)); b ^= a;
#define INJECT(x, y, part) a += x; b += y + part;
static inline void words(uint32_t k0, uint32_t k1, uint32_t counter, uint32_t stream, uint32_t *first, uint32_t *second)
{
    uint32_t k2 = k0 ^ k1 ^ 0x1BD11BDAu, a = counter + k0, b = stream + k1;
    ROUND(13) ROUND(15) ROUND(26) ROUND(6) INJECT(k1, k2, 1)
    ROUND(17) ROUND(29) ROUND(16) ROUND(24) INJECT(k2, k0, 2)
    ROUND(13) ROUND(15) ROUND(26) ROUND(6) INJECT(k0, k1, 3)
    ROUND(17)
    *first = a;
    *second = b;
}

/* Natural logarithm of a positive normal number, and e to a power between -80 and 0: two parts in ten million. */
static inline float natural_log(float x)
{
    union { float f; int32_t i; } bits = { x };
    int32_t e = ((bits.i - 0x3f3504f3) >> 23);
    bits.i -= e << 23;
    float m = bits.f - 1.0f, z = m * m;
    float y = 7.0376836292e-2f;
    y = y * m - 1.1514610310e-1f; y = y * m + 1.1676998740e-1f; y = y * m - 1.2420140846e-1f;
    y = y * m + 1.4249322787e-1f; y = y * m - 1.6668057665e-1f; y = y * m + 2.0000714765e-1f;
    y = y * m - 2.4999993993e-1f; y = y * m + 3.3333331174e-1f;
    return m + (y * m * z - 0.5f * z) + (float)e * 0.69314718056f;
}

static inline float power_of_e(float x)
{
    float n = rintf(x * 1.44269504f), r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
    float y = 1.9875691500e-4f;
    y = y * r + 1.3981999507e-3f; y = y * r + 8.3334519073e-3f; y = y * r + 4.1665795894e-2f;
    y = y * r + 1.6666665459e-1f; y = y * r + 5.0000001201e-1f;
    union { int32_t i; float f; } scale = { ((int32_t)n + 127) << 23 };
    return (y * r * r + r + 1.0f) * scale.f;
}

/* Two standard normal numbers of a counter (Box and Muller). */
static inline void normals(uint32_t k0, uint32_t k1, uint32_t counter, uint32_t stream, float *one, float *two)
{
    uint32_t a, b;
    words(k0, k1, counter, stream, &a, &b);
    float radius = sqrtf(-2.0f * natural_log(uniform(a)));
    float x = (uniform(b) - 0.5f) * 3.14159265f, y = x * x;
    float s = 1.0f / 6227020800.0f, c = 1.0f / 479001600.0f;
    s = s * y - 1.0f / 39916800.0f; s = s * y + 1.0f / 362880.0f; s = s * y - 1.0f / 5040.0f;
    s = s * y + 1.0f / 120.0f; s = s * y - 1.0f / 6.0f; s = (s * y + 1.0f) * x;
    c = c * y - 1.0f / 3628800.0f; c = c * y + 1.0f / 40320.0f; c = c * y - 1.0f / 720.0f;
    c = c * y + 1.0f / 24.0f; c = c * y - 0.5f; c = c * y + 1.0f;
    *one = radius * (2.0f * s * s - 1.0f);
    *two = radius * (-2.0f * s * c);
}

static inline float draw_speed(const Grids *g, uint32_t k0, uint32_t k1, uint32_t segment)
{
    uint32_t a, b;
    words(k0, k1, segment, 1, &a, &b);
    float place = uniform(a) * (float)(g->nodes - 1);
    int32_t cell = (int32_t)place;
    cell = within(cell, g->nodes - 2);
    float low = g->speeds[cell];
    return low + (place - (float)cell) * (g->speeds[cell + 1] - low);
}

static inline float polynomial(const float c[5], float y)
{
    return (((c[4] * y + c[3]) * y + c[2]) * y + c[1]) * y + c[0];
}

/* Heading (unit vector) to a point so many metres away, and the speed made good towards it. */
static inline void steer(float correction, float east, float north, float speed, float dac_east, float dac_north,
                         float *he, float *hn, float *good, float *distance)
{
    float far = sqrtf(east * east + north * north), safe = MAX(far, 1e-3f);
    float de = east / safe, dn = north / safe;
    float along = correction * (dac_east * de + dac_north * dn), across = correction * (dac_north * de - dac_east * dn);
    float sine = CLIP(-across / speed, -0.95f, 0.95f), cosine = sqrtf(1.0f - sine * sine);
    *he = de * cosine - dn * sine;
    *hn = dn * cosine + de * sine;
    *good = cosine * speed + along;
    *distance = far;
}

/* Water depth and its slopes per frame metre; NaN outside. */
static inline float depth_at(const Grids *g, float east, float north, float *gx, float *gy)
{
    float fx = (east - g->floor_x0) * g->floor_dx, fy = (north - g->floor_y0) * g->floor_dy;
    float ix = CLIP(floorf(fx), 0.0f, (float)(g->floor_nx - 1)), iy = CLIP(floorf(fy), 0.0f, (float)(g->floor_ny - 1));
    const float *table = g->floor;
    int32_t row = 4 * ((int32_t)iy * g->floor_nx + (int32_t)ix);
    float c0 = table[row], c1 = table[row + 1], c2 = table[row + 2], c3 = table[row + 3];
    fx -= ix;
    fy -= iy;
    *gx = (c1 + c3 * fy) * g->floor_dx;
    *gy = (c2 + c3 * fx) * g->floor_dy;
    float value = c0 + c1 * fx + c2 * fy + c3 * fx * fy;
    return (fx >= 0.0f) & (fx <= 1.0f) & (fy >= 0.0f) & (fy <= 1.0f) ? value : NAN;
}

/* One step of every member of a block that has not passed the output time: a bundle of yos or a stay at the surface.
   Stages follow dive.plan_dive, step._move, step._energies, step._verdict and step._advance. */
static void step(Block *restrict s, const Plan *restrict p, const Grids *restrict g, int32_t clock, float part, float base)
{
    const float *restrict table = g->currents, *restrict errors = g->error, *restrict points = g->waypoints;
    /* What is read under a condition is read before the loop: a load under a mask would not be vectorised. */
    const float every = p->every, stay = p->surface_stay, radius = p->radius, breaks_done = p->breaks_done,
                breaks_every = p->breaks_every, minimum_yo = p->minimum_yo;
#pragma omp simd
    for (int k = 0; k < W; k++) {
        int32_t go = (s->outcome[k] == FLYING) & (s->time[k] < p->interval);
        int32_t up = s->up[k], leg = s->leg[k];
        float time = s->time[k], absolute = base + time;
        /* Dive: how deep, how many, which way. */
        float y = s->north[k] / p->half_height;
        float sx = polynomial(p->stretch_east, y), sy = polynomial(p->stretch_north, y);
        float v = s->segment_speed[k] * s->speed[k], down = v * p->dive_tangent, climb = v * p->climb_tangent;
        float per_down = 1.0f / down, per_climb = 1.0f / climb;
        float zp = MAX(s->turn[k], s->depth[k] + minimum_yo);
        float top = MAX(p->climb_to - climb * p->overshoot_time, 0.3f * p->climb_to);
        float started = s->depth[k] * per_down, top_down = top * per_down, top_climb = top * per_climb;
        float first = zp * per_down - started, cycle = (zp - top) * (per_down + per_climb);
        float to_east = (points[2 * leg] - s->dr_east[k]) / sx;
        float to_north = (points[2 * leg + 1] - s->dr_north[k]) / sy;
        float he1, hn1, good, distance;
        steer(p->correction, to_east, to_north, v, s->dac_east[k], s->dac_north[k], &he1, &hn1, &good, &distance);
        float arrival = good > 1e-3f ? MAX(distance - radius, 0.0f) / MAX(good, 1e-3f) : FAR;
        int32_t last_leg = leg >= g->legs - 1;
        float remaining = s->due[k] - time;
        int32_t comes_up = last_leg & (arrival < remaining);
        remaining = comes_up ? arrival : remaining;
        int32_t reason = comes_up ? 3 : s->reason[k];
        float fit = floorf((remaining - first - cycle) / cycle);
        /* As many yos as end nearest to the next slot of time. */
        float until = p->slot * (floorf(time / p->slot + 0.5f) + 1.0f) - time, yos = rintf(until / cycle);
        yos = CLIP(MIN(yos, fit), 1.0f, 64.0f);
        float te1 = he1 * s->cosine[k] + hn1 * s->sine[k], tn1 = hn1 * s->cosine[k] - he1 * s->sine[k];
        float ratio = per_down + 0.5f * (yos - 1.0f) * (per_down + per_climb);
        float tau = first + 0.5f * (yos - 1.0f) * cycle - p->overshoot_time;
        float ve = (v * te1 + s->current_east[k]) * sx, vn = (v * tn1 + s->current_north[k]) * sy;
        float gx, gy, bottom = depth_at(g, s->east[k] + ve * tau, s->north[k] + vn * tau, &gx, &gy);
        float slope = CLIP((gx * ve + gy * vn) * ratio, -0.5f, 0.5f), over = down * p->overshoot_time;
        float wanted = (bottom - p->altitude + slope * (over - zp)) / (1.0f - slope);
        float turn = MIN(wanted, p->dive_to) + over;
        float least = MAX(s->depth[k], top) + minimum_yo;
        turn = MAX(turn, least);
        int32_t contact = turn > bottom - 0.5f;
        turn = contact ? bottom - 0.5f : turn;
        int32_t no_bottom = bottom != bottom, aground = (bottom < p->minimum_depth) | (turn < top + 0.5f);
        float reach = s->depth[k] + down * MAX(remaining, 0.0f) + over;
        float breaks = reason == 3 ? breaks_done : breaks_every;
        int32_t cut = (yos < 1.5f) & (reach < turn) & (breaks > 0.5f);
        turn = cut ? MAX(reach, s->depth[k] + 0.5f * minimum_yo) : turn;
        turn = aground | no_bottom ? least : turn;
        float low_down = turn * per_down, low_climb = turn * per_climb;
        float first_time = low_down - started, up_time = low_climb - top_climb, again = low_down - top_down;
        int32_t surfaces = (yos < 1.5f) & (remaining <= first_time + (breaks > 0.5f ? up_time : 0.0f));
        float climb_time = yos * up_time + (surfaces ? top_climb : 0.0f);
        float dive_time = first_time + (yos - 1.0f) * again;
        float dived = dive_time + climb_time, flown = v * dived;
        int32_t reached = arrival < dived;
        float share = reached & !comes_up ? arrival / dived : 1.0f;
        int32_t next = leg + 1 >= g->legs ? 0 : leg + 1;
        float from_east = s->dr_east[k] + (v * he1 + p->correction * s->dac_east[k]) * arrival * sx;
        float from_north = s->dr_north[k] + (v * hn1 + p->correction * s->dac_north[k]) * arrival * sy;
        float he2, hn2, unused, unused2;
        steer(p->correction, (points[2 * next] - from_east) / sx, (points[2 * next + 1] - from_north) / sy, v,
              s->dac_east[k], s->dac_north[k], &he2, &hn2, &unused, &unused2);
        float he = share * he1 + (1.0f - share) * he2, hn = share * hn1 + (1.0f - share) * hn2;
        float te = he * s->cosine[k] + hn * s->sine[k], tn = hn * s->cosine[k] - he * s->sine[k];
        /* Move: through the water and with it, midpoint rule. */
        float duration = up ? stay * s->stay[k] : dived, forward = up ? 0.0f : flown, half = 0.5f * duration;
        float east = s->east[k] + (0.5f * forward * te + s->current_east[k] * half) * sx;
        float north = s->north[k] + (0.5f * forward * tn + s->current_north[k] * half) * sy;
        float fx = (east - g->x0) * g->dx, fy = (north - g->y0) * g->dy;
        float ix = CLIP(floorf(fx), 0.0f, (float)(g->nx - 1)), iy = CLIP(floorf(fy), 0.0f, (float)(g->ny - 1));
        fx -= ix;
        fy -= iy;
        int32_t cell = (int32_t)iy * g->nx + (int32_t)ix;
        int32_t inside = (fx >= 0.0f) & (fx <= 1.0f) & (fy >= 0.0f) & (fy <= 1.0f);
        float ft = part + (time + half) * g->per_second, whole = floorf(ft), of = ft - whole;
        int32_t frame = clock + (int32_t)whole;
        of = frame >= g->frames - 1 ? 1.0f : of;
        frame = within(frame, g->frames - 2);
        int32_t a = 8 * (frame * g->nx * g->ny + cell), b = a + 8 * g->nx * g->ny;
        float fxy = fx * fy, before = 1.0f - of;
#define AT(c, i) (c[i] + c[i + 1] * fx + c[i + 2] * fy + c[i + 3] * fxy)
        float wu = before * AT(table, a) + of * AT(table, b), wv = before * AT(table, a + 4) + of * AT(table, b + 4);
        int32_t dry = !inside | (wu != wu), now = clock + (int32_t)floorf(part + time * g->per_second);
        int32_t late = (now < 0) | (now >= g->frames - 1);
        float noise_east, noise_north;
        normals(s->key0[k], s->key1[k], (uint32_t)s->steps[k], 2, &noise_east, &noise_north);
        float path = sqrtf(wu * wu + wv * wv) * duration + forward;
        float exponent = -duration / p->error_time - path / p->error_length;
        float memory = power_of_e(MAX(exponent, -80.0f)), kick = sqrtf(MAX(1.0f - memory * memory, 0.0f));
        float error_east = memory * s->error_east[k] + kick * noise_east;
        float error_north = memory * s->error_north[k] + kick * noise_north;
        float sd = 0.5f * errors[cell];
        float ce = wu + sd * (s->error_east[k] + error_east), cn = wv + sd * (s->error_north[k] + error_north);
        float de = forward * te + ce * duration, dn = forward * tn + cn * duration;
        east = s->east[k] + de * sx;
        north = s->north[k] + dn * sy;
        /* Energies and counts. */
        float dives = up ? 0.0f : yos;
        float d_pumped = dives * (s->pump[k] + s->pump_per_metre[k] * turn), d_retracted = dives * s->retract[k];
        float d_braked = 2.0f * dives * s->brake[k];
        float d_hotelled = (s->hotel[k] + (up ? s->surface[k] : 0.0f)) * duration;
        float d_dive_time = up ? 0.0f : dive_time, d_climb_time = up ? 0.0f : climb_time;
        float d_surface_time = up ? duration : 0.0f, d_inflections = 2.0f * dives;
        float d_surfacings = surfaces & !up ? 1.0f : 0.0f, d_through_water = forward;
        float d_over_ground = sqrtf(de * de + dn * dn);
#define TOTAL(name) float all_##name = s->name[k] + d_##name;
        SUMS(TOTAL)
        float spent = all_pumped + all_retracted + all_braked + all_hotelled + s->power_dive[k] * all_dive_time +
                      s->power_climb[k] * all_climb_time + s->power_surface[k] * all_surface_time +
                      s->per_surfacing[k] * all_surfacings + s->per_inflection[k] * all_inflections;
        /* Verdict. */
        int32_t comes = surfaces & !up, arrives = reached & !up, finished = arrives & last_leg, done = s->done[k] | finished;
        int32_t outcome = comes & done ? ARRIVED : FLYING;
        outcome = (absolute + duration > p->overtime) & (outcome == FLYING) ? ABORTED : outcome;
        outcome = spent > s->limit[k] ? s->limit_code[k] : outcome;
        float check = east + north + duration + spent;
        int32_t stuck = (check - check) == 0.0f ? FLYING : INVALID;
        stuck = dry ? LEFT_AREA : stuck;
        stuck = late ? LEFT_TIME : stuck;
        stuck = aground & !up ? AGROUND : stuck;
        stuck = no_bottom & !up ? LEFT_FLOOR : stuck;
        stuck = ((down <= 0.005f) | (climb <= 0.005f)) & !up ? STALLED : stuck;
        int32_t ok = go & (stuck == FLYING);
        float end = absolute + duration;
        s->outcome[k] = go ? (stuck != FLYING ? stuck : outcome) : s->outcome[k];
        s->end_time[k] = go ? (stuck != FLYING ? absolute : end) : s->end_time[k];
        /* Advance. */
#define SET(name, value) s->name[k] = ok ? (value) : s->name[k]
        float under = MAX(absolute - s->dive_clock[k], 60.0f);
        float fresh_east = p->correction * s->dac_east[k] + (s->east[k] - s->dr_east[k]) / sx / under;
        float fresh_north = p->correction * s->dac_north[k] + (s->north[k] - s->dr_north[k]) / sy / under;
        float told_east = s->dr_east[k] + (flown * he + p->correction * s->dac_east[k] * duration) * sx;
        float told_north = s->dr_north[k] + (flown * hn + p->correction * s->dac_north[k] * duration) * sy;
        SET(last_time, duration);
        SET(last_east, east - s->east[k]);
        SET(last_north, north - s->north[k]);
        SET(last_turn, up ? 0.0f : turn);
        SET(last_top, surfaces ? 0.0f : top);
        SET(last_dive, dive_time / yos);
        SET(last_climb, climb_time / yos);
        SET(last_up, up);
        SET(contacts, s->contacts[k] + (contact & !up ? yos : 0.0f));
        SET(east, east);
        SET(north, north);
        SET(dr_east, up ? east : told_east);
        SET(dr_north, up ? north : told_north);
        SET(dac_east, up ? fresh_east : s->dac_east[k]);
        SET(dac_north, up ? fresh_north : s->dac_north[k]);
        SET(depth, up | surfaces ? 0.0f : top);
        SET(turn, up | surfaces ? s->turn[k] : turn);
        SET(due, up ? MAX(time + every, time + duration + 60.0f) : s->due[k]);
        SET(dive_clock, up ? end : s->dive_clock[k]);
        float drawn = draw_speed(g, s->key0[k], s->key1[k], (uint32_t)(int32_t)s->surfacings[k]);
        SET(segment_speed, up ? drawn : s->segment_speed[k]);
        SET(error_east, error_east);
        SET(error_north, error_north);
        SET(current_east, ce);
        SET(current_north, cn);
#define ADD(name) SET(d_##name, d_##name); SET(name, all_##name);
        SUMS(ADD)
        float arrived = absolute + (comes_up ? dived : arrival);
        SET(arrival_0, arrives & (leg == 0) & (s->arrival_0[k] != s->arrival_0[k]) ? arrived : s->arrival_0[k]);
        SET(arrival_1, arrives & (leg == 1) & (s->arrival_1[k] != s->arrival_1[k]) ? arrived : s->arrival_1[k]);
        int32_t here = ok & comes, gone = ok & up;
#define LOG(flag, to, from, t, e, n, r) \
        s->from##_time[k] = flag ? s->to##_time[k] : s->from##_time[k]; \
        s->from##_east[k] = flag ? s->to##_east[k] : s->from##_east[k]; \
        s->from##_north[k] = flag ? s->to##_north[k] : s->from##_north[k]; \
        s->from##_reason[k] = flag ? s->to##_reason[k] : s->from##_reason[k]; \
        s->to##_time[k] = flag ? t : s->to##_time[k]; \
        s->to##_east[k] = flag ? e : s->to##_east[k]; \
        s->to##_north[k] = flag ? n : s->to##_north[k]; \
        s->to##_reason[k] = flag ? (float)(r) : s->to##_reason[k];
        LOG(here, surfaced, before, end, east, north, reason)
        LOG(gone, left, leftbefore, end, east, north, reason)
        SET(reason, up ? 0 : s->reason[k]);
        SET(leg, arrives ? within(leg + 1, g->legs - 1) : leg);
        SET(done, done);
        SET(up, comes);
        SET(steps, s->steps[k] + 1);
        SET(time, time + duration);
    }
}

/* A mission about to dive, as ensemble.initial_state makes it. */
static void begin(Block *restrict s, const Plan *restrict p, const Grids *restrict g)
{
    float sx = polynomial(p->stretch_east, p->start_north / p->half_height);
    float sy = polynomial(p->stretch_north, p->start_north / p->half_height);
    for (int k = 0; k < W; k++) {
        float off_east, off_north, gx, gy;
        normals(s->key0[k], s->key1[k], 0, 3, &off_east, &off_north);
        normals(s->key0[k], s->key1[k], 1, 3, &s->error_east[k], &s->error_north[k]);
        s->east[k] = s->dr_east[k] = p->start_east + p->fix_sd * off_east * sx;
        s->north[k] = s->dr_north[k] = p->start_north + p->fix_sd * off_north * sy;
        float here = depth_at(g, s->east[k], s->north[k], &gx, &gy);
        s->turn[k] = here != here ? p->dive_to : CLIP(here - p->altitude, p->minimum_yo, p->dive_to);
        s->due[k] = MAX(p->every, 60.0f);
        s->segment_speed[k] = draw_speed(g, s->key0[k], s->key1[k], 0);
        s->last_time[k] = s->last_dive[k] = s->last_climb[k] = 1.0f;
        s->last_up[k] = 1;
        s->end_time[k] = s->arrival_0[k] = s->arrival_1[k] = NAN;
        s->surfaced_time[k] = s->before_time[k] = s->left_time[k] = s->leftbefore_time[k] = NAN;
        s->surfaced_east[k] = s->before_east[k] = s->left_east[k] = s->leftbefore_east[k] = NAN;
        s->surfaced_north[k] = s->before_north[k] = s->left_north[k] = s->leftbefore_north[k] = NAN;
        s->surfaced_reason[k] = s->before_reason[k] = s->left_reason[k] = s->leftbefore_reason[k] = -1.0f;
    }
}

/* The record at an output time within the step just made, as ensemble._output: rows of arrays.RECORD, members inside. */
static void record(const Block *restrict s, const Plan *restrict p, float base, float *restrict to, int64_t stride)
{
#pragma omp simd
    for (int k = 0; k < W; k++) {
        float back = MAX(s->time[k] - p->interval, 0.0f), share = CLIP(back / s->last_time[k], 0.0f, 1.0f);
        float period = s->last_dive[k] + s->last_climb[k];
        float rest = back < s->last_climb[k] ? back : back - floorf(back / period) * period;
        int32_t rising = rest < s->last_climb[k];
        float span = s->last_turn[k] - s->last_top[k];
        float risen = s->last_top[k] + span * rest / MAX(s->last_climb[k], 1.0f);
        float sunk = s->last_turn[k] - span * ((rest - s->last_climb[k]) / MAX(s->last_dive[k], 1.0f));
        float depth = s->last_up[k] ? 0.0f : MAX(rising ? risen : sunk, 0.0f);
        int32_t flying = (s->outcome[k] == FLYING) | (s->end_time[k] > base + p->interval);
        int row = 0;
#define PUT(value) to[(row++) * stride + k] = (value);
        PUT(s->east[k] - share * s->last_east[k])
        PUT(s->north[k] - share * s->last_north[k])
        PUT(flying ? depth : 0.0f)
        PUT(s->last_up[k] | !flying ? 3.0f : rising ? 1.0f : 2.0f)
        PUT((float)flying)
        PUT(s->current_east[k])
        PUT(s->current_north[k])
#define SUM(name) PUT(s->name[k] - share * s->d_##name[k])
        SUMS(SUM)
#define EVENT(log) PUT(s->log##_time[k]) PUT(s->log##_east[k]) PUT(s->log##_north[k]) PUT(s->log##_reason[k])
        EVENT(surfaced) EVENT(before) EVENT(left) EVENT(leftbefore)
    }
}

#define ROWS 34

typedef struct {
    const Plan *plan;
    const Grids *grids;
    Block *blocks;
    float *records;
    int64_t first, last, members;
    int32_t outputs;
} Share;

static void *fly_share(void *given)
{
    Share *share = given;
    const Plan *p = share->plan;
    const Grids *g = share->grids;
    float rate = p->interval * g->per_second, rest = rate - floorf(rate);
    float begins = -g->first * g->per_second;
    for (int64_t i = share->first; i < share->last; i++)
        begin(&share->blocks[i], p, g);
    /* All blocks fly one interval before the next: the frames of the currents that they need then stay in the cache. */
    for (int32_t o = 0; o < share->outputs; o++) {
        float base = (float)o * p->interval, f = begins - floorf(begins) + rest * (float)o, lift = floorf(f);
        int32_t clock = (int32_t)floorf(begins) + (int32_t)floorf(rate) * o + (int32_t)lift;
        for (int64_t i = share->first; i < share->last; i++) {
            Block *s = &share->blocks[i];
            for (;;) {
                int32_t pending = 0;
                for (int k = 0; k < W; k++)
                    pending |= (s->outcome[k] == FLYING) & (s->time[k] < p->interval);
                if (!pending)
                    break;
                step(s, p, g, clock, f - lift, base);
            }
            record(s, p, base, share->records + (int64_t)o * ROWS * share->members + i * W, share->members);
            for (int k = 0; k < W; k++) {
                s->time[k] -= p->interval;
                s->due[k] -= p->interval;
            }
        }
    }
    return 0;
}

/* Fly all members. `member` holds rows of arrays.MEMBER, (row, members); `members` is a multiple of W; `records` is
   (output, row, member); `final` takes outcome, steps, contacts, end time and the two arrivals, (row, member). */
int fly(const Plan *p, const Grids *g, const float *member, const uint32_t *keys, const int32_t *codes, Block *blocks,
        float *records, float *final, int64_t members, int32_t outputs, int32_t threads)
{
    int64_t count = members / W;
    memset(blocks, 0, sizeof(Block) * (size_t)count);
    for (int64_t i = 0; i < count; i++) {
        Block *s = &blocks[i];
        const float *from = member + i * W;
#define TAKE(name) memcpy(s->name, from, sizeof s->name); from += members;
        MEMBER(TAKE)
        memcpy(s->key0, keys + i * W, sizeof s->key0);
        memcpy(s->key1, keys + members + i * W, sizeof s->key1);
        memcpy(s->limit_code, codes + i * W, sizeof s->limit_code);
    }
    pthread_t ids[64];
    Share shares[64];
    threads = threads < 1 ? 1 : within(threads, 64);
    for (int32_t t = 0; t < threads; t++) {
        shares[t] = (Share){ p, g, blocks, records, count * t / threads, count * (t + 1) / threads, members, outputs };
        if (t + 1 < threads && pthread_create(&ids[t], 0, fly_share, &shares[t]))
            return 1;
    }
    fly_share(&shares[threads - 1]);
    for (int32_t t = 0; t + 1 < threads; t++)
        pthread_join(ids[t], 0);
    for (int64_t i = 0; i < count; i++)
        for (int k = 0; k < W; k++) {
            float *to = final + i * W + k;
            to[0] = (float)blocks[i].outcome[k];
            to[members] = (float)blocks[i].steps[k];
            to[2 * members] = blocks[i].contacts[k];
            to[3 * members] = blocks[i].end_time[k];
            to[4 * members] = blocks[i].arrival_0[k];
            to[5 * members] = blocks[i].arrival_1[k];
        }
    return 0;
}

int64_t block_bytes(void) { return (int64_t)sizeof(Block); }
