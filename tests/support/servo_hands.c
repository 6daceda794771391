#include <math.h>

static double clip(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
static double sign(double x) { return (x > 0) - (x < 0); }
static double slowed(double free, double grip) {
  double left = fabs(free) - grip;
  return sign(free) * (left > 0 ? left : 0);
}

/* one hand: T tendons, J joints, M motors */
void advance(long T, long J, long M, long steps, double step, const double* servo,
             const double* arms, const double* spools, const double* low, const double* high,
             const double* slack, const double* stiffness, const double* sheath, const double* spring,
             const double* rest, const double* dry, const double* axle, const double* weight,
             const double* gear_friction, const double* gear_load, const double* broken,
             const double* slips, const double* limits, const double* goals,
             double* angles, double* rates, double* places, double* speeds, double* nodes,
             double* torques, double* slipped) {
  double near[T], far[T], grips[T];
  for (long t = 0; t < T; ++t) grips[t] = exp(sheath[t]);
  for (long k = 0; k < steps; ++k) {
    for (long t = 0; t < T; ++t) {
      double wound = -slack[t], drawn = 0, spring_of = 2 * stiffness[t], grip = grips[t];
      for (long m = 0; m < M; ++m) wound += spools[t * M + m] * (places[m] - slipped[m]);
      for (long j = 0; j < J; ++j) drawn += arms[t * J + j] * angles[j];
      double pulls = fmax(spring_of * (wound - nodes[t]), 0), held = fmax(spring_of * (nodes[t] - drawn), 0);
      if (wound <= drawn) nodes[t] = clip(nodes[t], wound, drawn);
      else if (pulls > grip * held) nodes[t] = (wound + grip * drawn) / (1 + grip);
      else if (grip * pulls < held) nodes[t] = (grip * wound + drawn) / (grip + 1);
      near[t] = broken[t] ? 0 : fmax(spring_of * (wound - nodes[t]), 0);
      far[t] = broken[t] ? 0 : fmax(spring_of * (nodes[t] - drawn), 0);
    }
    for (long m = 0; m < M; ++m) {
      double load = 0, left = goals[m] - places[m], inertia = 2e-4;
      for (long t = 0; t < T; ++t) load += spools[t * M + m] * near[t];
      left -= clip(left, -servo[2], servo[2]);
      torques[m] = clip(servo[0] * left - servo[1] * speeds[m], -limits[m], limits[m]);
      double free = speeds[m] + step / inertia * (torques[m] - load);
      speeds[m] = slowed(free, step / inertia * (gear_friction[m] + gear_load[m] * fabs(load)));
      places[m] += step * speeds[m];
      if (fabs(load) > slips[m]) slipped[m] += sign(load) * 0.4 * step * 20;
    }
    for (long j = 0; j < J; ++j) {
      double pull = 0, side = 0, inertia = 1e-5;
      for (long t = 0; t < T; ++t) pull += arms[t * J + j] * far[t], side += fabs(arms[t * J + j]) * far[t];
      double torque = pull - spring[j] * (angles[j] - rest[j]) - weight[j] * sin(angles[j]) - 1e-3 * rates[j];
      double over = fmax(angles[j] - high[j], 0) - fmax(low[j] - angles[j], 0);
      if (over != 0) torque -= 25.0 * over + 0.02 * rates[j];
      rates[j] = slowed(rates[j] + step / inertia * torque, step / inertia * (dry[j] + axle[j] * side));
      angles[j] += step * rates[j];
    }
  }
}
