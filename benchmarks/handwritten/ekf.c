/* The extended Kalman filter `ekf` on the paper's rig, written by hand: the practical limit for a generated one.
 *
 * The same algorithm: kick-drift-kick leapfrog with projected friction and implicit stops, slopes through every sub-step,
 * two scalar updates. What a person would exploit is exploited: each tendon knows only its own slider, a slider's row has
 * zeros, a measurement picks one state, the covariance is symmetric.
 *
 * p: inertia, damping, mu, r_a, T0, (m, b, load, low, high, k_s, b_s) x 2, (r, l, k) x 2, reference; nominal pulls (2);
 * variances of pulls (2), of the process (6), of the positions (2). State: theta, x1, x2 and their rates.
 */
#include <math.h>

#define COUNT 15
#define C 8 /* columns of the slopes: six states, two pulls */

typedef struct {
  double a[3], b[3], share[3];
} response;

static void respond(const double* p, double length, double drift, response* out) {
  int i;
  for (i = 0; i < 3; ++i) {
    const double inertia = i ? p[7 * i - 2] : p[0], damping = i ? p[7 * i - 1] : p[1];
    const double x = damping * length / inertia;
    out->a[i] = exp(-x);
    out->b[i] = length / inertia * (x < 1e-5 ? 1 - x / 2 + x * x / 6 : -expm1(-x) / x);
    out->share[i] = i && p[7 * i + 3] * drift * drift / inertia <= 1 ? 0.5 : 1;
  }
}

/* What friction leaves of z: 1 or -1 where it slips, 0 where it sticks. */
static int slips(double z, double limit, double* left) {
  if (z > limit) return *left = z - limit, 1;
  if (z < -limit) return *left = z + limit, -1;
  return *left = 0, 0;
}

/* One kick; with `drift` the drift that follows, else the half kick that ends the interval. */
static void kick(const double* p, const response* r, double h, const double* pull, double* q, double* v, double sq[3][C],
                 double sv[3][C], int drift) {
  const double s = sin(q[0]), c = cos(q[0]);
  double force[3] = {0, pull[0], pull[1]}, limit[3], slope[3][3] = {{0}}, steep[3][3] = {{0}};
  double total = 0;
  int i, k;
  for (i = 0; i < 2; ++i) {
    const double radius = p[19 + 3 * i], length = p[20 + 3 * i], stiffness = p[21 + 3 * i], side = i ? -1 : 1;
    const double across = radius * (1 - c), along = length + q[1 + i] - side * radius * s;
    const double now = sqrt(across * across + along * along), one = 1 / now;
    const double da = radius * s, db = -side * radius * c;
    const double lt = (across * da + along * db) * one, lx = along * one;
    const double elastic = stiffness * (now - length), tension = elastic > 0 ? elastic : 0;
    const double taut = elastic > 0 ? stiffness : 0;
    const double ltt = (da * da + across * radius * c + db * db + along * side * radius * s - lt * lt) * one;
    const double ltx = (db - lt * lx) * one, lxx = (1 - lx * lx) * one;
    force[0] -= lt * tension;
    force[1 + i] -= lx * tension;
    slope[0][0] -= ltt * tension + taut * lt * lt;
    slope[0][1 + i] = slope[1 + i][0] = -(ltx * tension + taut * lt * lx);
    slope[1 + i][1 + i] = -(lxx * tension + taut * lx * lx);
    total += tension;
    limit[1 + i] = p[7 + 7 * i] * tension;
    steep[1 + i][0] = p[7 + 7 * i] * taut * lt;
    steep[1 + i][1 + i] = p[7 + 7 * i] * taut * lx;
    steep[0][0] += p[2] * p[3] * taut * lt;
    steep[0][1 + i] = p[2] * p[3] * taut * lx;
  }
  limit[0] = p[2] * p[3] * (p[4] + total);
  {
    double moved[3][C];
    for (i = 0; i < 3; ++i) {
      const double a = r->a[i], b = r->b[i], z = a * v[i] + b * force[i];
      double left, held = 1, by_place = 0;
      int sign = slips(z, b * limit[i], &left);
      if (i) {
        const double low = p[7 * i + 1], high = p[7 * i + 2], k_s = p[7 * i + 3], b_s = p[7 * i + 4];
        double end = q[i] + h * left, pressed, place;
        int touches, other;
        if (drift) {
          const int at_high = end > high && k_s * (end - high) + b_s * left > 0;
          const int at_low = end < low && k_s * (end - low) + b_s * left < 0;
          touches = at_high || at_low;
          place = at_high ? high : low;
        } else {
          touches = q[i] > high || q[i] < low;
          place = q[i] > high ? high : low;
        }
        if (touches) {
          const double stiff = 1 + b * (r->share[i] * k_s * h + b_s);
          other = slips(z - b * k_s * (q[i] - place), b * limit[i], &pressed);
          if (drift || (q[i] > high ? pressed / stiff < left : pressed / stiff > left)) {
            left = pressed;
            sign = other;
            held = 1 / stiff;
            by_place = b * k_s;
          }
        }
      }
      v[i] = left * held;
      if (!sign) {
        for (k = 0; k < C; ++k) moved[i][k] = 0;
        continue;
      }
      {
        const double mine = held * a;
        double own[3];
        for (k = 0; k < 3; ++k) own[k] = held * b * (slope[i][k] - sign * steep[i][k]);
        own[i] -= held * by_place;
        if (i == 0)
          for (k = 0; k < C; ++k) moved[0][k] = mine * sv[0][k] + own[0] * sq[0][k] + own[1] * sq[1][k] + own[2] * sq[2][k];
        else
          for (k = 0; k < C; ++k) moved[i][k] = mine * sv[i][k] + own[0] * sq[0][k] + own[i] * sq[i][k];
        if (i) moved[i][5 + i] += held * b;
      }
    }
    for (i = 0; i < 3; ++i)
      for (k = 0; k < C; ++k) sv[i][k] = moved[i][k];
  }
  if (!drift) return;
  for (i = 0; i < 3; ++i) {
    q[i] += h * v[i];
    for (k = 0; k < C; ++k) sq[i][k] += h * sv[i][k];
  }
}

static void step(const double* carry, const double* x, const double* p, double* next, double* y) {
  const double dt = x[0], h = dt / COUNT;
  double q[3], v[3], sq[3][C] = {{0}}, sv[3][C] = {{0}}, before[2], after[2], now[2], mid[6][C], P[6][6];
  response half, full;
  int i, j, k;
  for (i = 0; i < 3; ++i) {
    q[i] = carry[i];
    v[i] = carry[3 + i];
    sq[i][i] = sv[i][3 + i] = 1;
  }
  for (i = 0; i < 2; ++i) {
    before[i] = carry[42 + i];
    after[i] = x[7 + i] > 0 ? x[3 + i] : before[i];
  }
  respond(p, h / 2, h, &half);
  respond(p, h, h, &full);
  for (k = 0; k < COUNT; ++k) {
    for (i = 0; i < 2; ++i) now[i] = before[i] + (double)k / COUNT * (after[i] - before[i]);
    kick(p, k ? &full : &half, h, now, q, v, sq, sv, 1);
  }
  kick(p, &half, h, after, q, v, sq, sv, 0);
  /* P = S P S' + G q_u G' + q_x dt, the lower triangle, then mirrored */
  for (i = 0; i < 6; ++i) {
    const double* row = i < 3 ? sq[i] : sv[i - 3];
    for (j = 0; j < 6; ++j) {
      double sum = 0;
      for (k = 0; k < 6; ++k) sum += row[k] * carry[6 + 6 * k + j];
      mid[i][j] = sum;
    }
  }
  for (i = 0; i < 6; ++i) {
    const double* row = i < 3 ? sq[i] : sv[i - 3];
    for (j = 0; j <= i; ++j) {
      const double* other = j < 3 ? sq[j] : sv[j - 3];
      double sum = row[6] * other[6] * p[28] + row[7] * other[7] * p[29];
      for (k = 0; k < 6; ++k) sum += mid[i][k] * other[k];
      if (i == j) sum += p[30 + i] * dt;
      P[i][j] = P[j][i] = sum;
    }
  }
  for (i = 0; i < 2; ++i) {
    const int at = 1 + i, there = x[5 + i] > 0;
    const double spread = P[at][at] + p[36 + i], value = x[1 + i] - q[at];
    double gain[6], across[6];
    y[i] = value;
    y[2 + i] = spread;
    if (!there) continue;
    for (j = 0; j < 6; ++j) {
      across[j] = P[j][at];
      gain[j] = across[j] / spread;
    }
    for (j = 0; j < 3; ++j) {
      q[j] += gain[j] * value;
      v[j] += gain[3 + j] * value;
    }
    for (j = 0; j < 6; ++j)
      for (k = 0; k <= j; ++k) P[j][k] = P[k][j] = P[j][k] - gain[j] * across[k];
  }
  for (i = 0; i < 3; ++i) {
    next[i] = q[i];
    next[3 + i] = v[i];
  }
  for (i = 0; i < 6; ++i)
    for (j = 0; j < 6; ++j) next[6 + 6 * i + j] = P[i][j];
  next[42] = after[0];
  next[43] = after[1];
}

long long ekf_scan(long long n, const double* carry, const double* x, const double* p, double* carries, double* y) {
  long long k;
  for (k = 0; k < n; ++k) {
    step(carry, x + 9 * k, p, carries + 44 * k, y + 4 * k);
    carry = carries + 44 * k;
  }
  return n;
}
