/* capstan_adaptive.h: `adaptive` for the rig "Capstan-driven joint"
 *
 * Where a tendon-driven joint is, from what is measured at the proximal end.
 * Written by `distal export-c`. C99, no malloc, no globals: the caller owns the state.
 * All numbers are SI; NAN is a missing value.
 *
 * values, in this order:
 *   0  motor_angle: position of motor [rad]
 *   1  motor_torque: force of motor [N m]
 *
 * states, in this order (means first in `kernel_state`, then the covariance,
 * 8 x 8, then what is remembered):
 *   0  theta [rad]
 *   1  theta_dot [rad/s]
 *   2  friction coefficient of joint jaw [1]
 *   3  friction constant of drive motor [N m]
 *   4  friction load of drive motor [1]
 *   5  pretension of tendon flexor [N]
 *   6  pretension of tendon extensor [N]
 *   7  common factor of tendons.stiffness [1]
 *
 * innovations, in this order:
 *   0  motor_torque
 */
#ifndef CAPSTAN_ADAPTIVE_H
#define CAPSTAN_ADAPTIVE_H

#ifdef __cplusplus
extern "C" {
#endif

#define CAPSTAN_ADAPTIVE_CHANNELS 2
#define CAPSTAN_ADAPTIVE_STATES 8
#define CAPSTAN_ADAPTIVE_MEASURED 1
#define CAPSTAN_ADAPTIVE_KERNEL_STATE 84
#define CAPSTAN_ADAPTIVE_INTERVAL 0.005f /* nominal time between samples [s] */

typedef float capstan_adaptive_real;

/* What the filter believes; copy it, keep it, restore it. */
typedef struct {
  capstan_adaptive_real kernel_state[CAPSTAN_ADAPTIVE_KERNEL_STATE];
  int samples; /* how many were taken in, at most 2 is kept */
} capstan_adaptive_state;

typedef struct {
  capstan_adaptive_real angle; /* angle of jaw [rad] */
  capstan_adaptive_real angle_std; /* standard deviation of its error [rad] */
  /* measured minus predicted, NAN where nothing was compared */
  capstan_adaptive_real innovations[1];
  capstan_adaptive_real innovation_variances[1];
} capstan_adaptive_output;

/* What tells whether the stream can be trusted. */
typedef struct {
  int begun;
  capstan_adaptive_real memory[9];
} capstan_adaptive_watch;

/* the codes of a step */
enum {
  CAPSTAN_ADAPTIVE_OK = 0,
  /* dt is less than a nanosecond (zero is for the first sample): nothing was changed */
  CAPSTAN_ADAPTIVE_LATE = 1,
  CAPSTAN_ADAPTIVE_GAP = 2,    /* dt is too long to bridge: nothing was changed, begin again */
  CAPSTAN_ADAPTIVE_BAD = 3,    /* a value is infinite or wild, beyond 1e7: nothing was changed */
  CAPSTAN_ADAPTIVE_LOST = 4    /* the filter left all bounds: begin again */
};

/* The health of a sample that was taken in; where several hold, the last one. Their meaning is that
 * of `distal stream`. */
enum {
  CAPSTAN_ADAPTIVE_HEALTH_OK = 0,
  CAPSTAN_ADAPTIVE_HEALTH_UNTESTED = 1,
  CAPSTAN_ADAPTIVE_HEALTH_MISSING = 2,
  CAPSTAN_ADAPTIVE_HEALTH_GAP = 3,
  CAPSTAN_ADAPTIVE_HEALTH_OUTSIDE = 4,
  CAPSTAN_ADAPTIVE_HEALTH_TOUCHED = 5,
  CAPSTAN_ADAPTIVE_HEALTH_DISAGREES = 6,
  CAPSTAN_ADAPTIVE_HEALTH_DEAD = 7,
  CAPSTAN_ADAPTIVE_HEALTH_RESTARTED = 8
};

/* Set the state to what is believed before the first sample, whose values fill what has no
 * prior. */
void capstan_adaptive_begin(capstan_adaptive_state* state, const capstan_adaptive_real* values);

/* Begin anew where the filter was: at its angles, within the joints' stops, which may be 0.5 rad
 * off. */
void capstan_adaptive_restart(capstan_adaptive_state* state, const capstan_adaptive_real* values);

/* Take in a sample, dt [s] after the last one that was taken in (0 for the first); `out` may be a
 * null pointer. */
int capstan_adaptive_step(capstan_adaptive_state* state, capstan_adaptive_real dt, const capstan_adaptive_real* values, capstan_adaptive_output* out);

/* Begin to watch, when the filter begins. */
void capstan_adaptive_watch_begin(capstan_adaptive_watch* watch);

/* Say how healthy the stream is, after a step that returned CAPSTAN_ADAPTIVE_OK, with its dt, values and
 * output. */
int capstan_adaptive_health(capstan_adaptive_watch* watch, const capstan_adaptive_state* state, capstan_adaptive_real dt,
                  const capstan_adaptive_real* values,
                  const capstan_adaptive_output* out);

#ifdef __cplusplus
}
#endif

#endif
