/* capstan_ekf_2008.h: `ekf-2008` for the rig "Capstan-driven joint"
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
 * 4 x 4, then what is remembered):
 *   0  theta [rad]
 *   1  position_motor [rad]
 *   2  theta_dot [rad/s]
 *   3  velocity_motor [rad/s]
 *
 * innovations, in this order:
 *   0  motor_angle
 */
#ifndef CAPSTAN_EKF_2008_H
#define CAPSTAN_EKF_2008_H

#ifdef __cplusplus
extern "C" {
#endif

#define CAPSTAN_EKF_2008_CHANNELS 2
#define CAPSTAN_EKF_2008_STATES 4
#define CAPSTAN_EKF_2008_MEASURED 1
#define CAPSTAN_EKF_2008_KERNEL_STATE 21
#define CAPSTAN_EKF_2008_INTERVAL 0.005f /* nominal time between samples [s] */

typedef float capstan_ekf_2008_real;

/* What the filter believes; copy it, keep it, restore it. */
typedef struct {
  capstan_ekf_2008_real kernel_state[CAPSTAN_EKF_2008_KERNEL_STATE];
  int samples; /* how many were taken in, at most 2 is kept */
} capstan_ekf_2008_state;

typedef struct {
  capstan_ekf_2008_real angle; /* angle of jaw [rad] */
  capstan_ekf_2008_real angle_std; /* standard deviation of its error [rad] */
  /* measured minus predicted, NAN where nothing was compared */
  capstan_ekf_2008_real innovations[1];
  capstan_ekf_2008_real innovation_variances[1];
} capstan_ekf_2008_output;

/* What tells whether the stream can be trusted. */
typedef struct {
  int begun;
  capstan_ekf_2008_real memory[9];
} capstan_ekf_2008_watch;

/* the codes of a step */
enum {
  CAPSTAN_EKF_2008_OK = 0,
  /* dt is less than a nanosecond (zero is for the first sample): nothing was changed */
  CAPSTAN_EKF_2008_LATE = 1,
  CAPSTAN_EKF_2008_GAP = 2,    /* dt is too long to bridge: nothing was changed, begin again */
  CAPSTAN_EKF_2008_BAD = 3,    /* a value is infinite or wild, beyond 1e7: nothing was changed */
  CAPSTAN_EKF_2008_LOST = 4    /* the filter left all bounds: begin again */
};

/* The health of a sample that was taken in; where several hold, the last one. Their meaning is that
 * of `distal stream`. */
enum {
  CAPSTAN_EKF_2008_HEALTH_OK = 0,
  CAPSTAN_EKF_2008_HEALTH_UNTESTED = 1,
  CAPSTAN_EKF_2008_HEALTH_MISSING = 2,
  CAPSTAN_EKF_2008_HEALTH_GAP = 3,
  CAPSTAN_EKF_2008_HEALTH_OUTSIDE = 4,
  CAPSTAN_EKF_2008_HEALTH_TOUCHED = 5,
  CAPSTAN_EKF_2008_HEALTH_DISAGREES = 6,
  CAPSTAN_EKF_2008_HEALTH_DEAD = 7,
  CAPSTAN_EKF_2008_HEALTH_RESTARTED = 8
};

/* Set the state to what is believed before the first sample, whose values fill what has no
 * prior. */
void capstan_ekf_2008_begin(capstan_ekf_2008_state* state, const capstan_ekf_2008_real* values);

/* Begin anew where the filter was: at its angles, within the joints' stops, which may be 0.5 rad
 * off. */
void capstan_ekf_2008_restart(capstan_ekf_2008_state* state, const capstan_ekf_2008_real* values);

/* Take in a sample, dt [s] after the last one that was taken in (0 for the first); `out` may be a
 * null pointer. */
int capstan_ekf_2008_step(capstan_ekf_2008_state* state, capstan_ekf_2008_real dt, const capstan_ekf_2008_real* values, capstan_ekf_2008_output* out);

/* Begin to watch, when the filter begins. */
void capstan_ekf_2008_watch_begin(capstan_ekf_2008_watch* watch);

/* Say how healthy the stream is, after a step that returned CAPSTAN_EKF_2008_OK, with its dt, values and
 * output. */
int capstan_ekf_2008_health(capstan_ekf_2008_watch* watch, const capstan_ekf_2008_state* state, capstan_ekf_2008_real dt,
                  const capstan_ekf_2008_real* values,
                  const capstan_ekf_2008_output* out);

#ifdef __cplusplus
}
#endif

#endif
