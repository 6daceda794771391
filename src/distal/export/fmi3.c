/* $name$_fmi3.c: the filter as an FMU for co-simulation, FMI 3.0. Written by `distal export-fmu`.
 *
 * An input is a sensor's value, NAN where it is missing. A sample is taken in when the initialization ends, and whenever a
 * step begins at least half a nominal interval after the last sample. Outputs are those at the current time: the prior
 * before the first sample, after a step the prediction of its end from the last sample, whose health is told.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "$name$.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* the types of FMI 3.0 (fmi-standard.org), as far as they are used here */
typedef void* fmi3Instance;
typedef void* fmi3InstanceEnvironment;
typedef uint32_t fmi3ValueReference;
typedef const char* fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3Callback)(void);

/* functions of the standard have parameters that are not used here */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define INPUTS $NAME$_CHANNELS
#define OUTPUTS $n_outputs$
#define NOT_YET $not_yet$ /* health before the first sample */

/* all that changes */
typedef struct {
  $name$_state filter;
  $name$_watch watch;
  $name$_output out;
  double inputs[INPUTS];
  double time;    /* current */
  double sampled; /* of the last sample */
  int32_t begun;
  int32_t health;
} snapshot;

typedef struct {
  snapshot now;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
} instance;

static void absent(double values[]) {
  int i;
  for (i = 0; i < INPUTS; ++i) values[i] = NAN;
}

static void cleared(snapshot* now) {
  memset(now, 0, sizeof *now);
  absent(now->inputs);
  now->health = NOT_YET;
}

static double root(double variance) { return variance <= 0.0 ? 0.0 : sqrt(variance); }

/* what is believed before the first sample */
static void prior(snapshot* now) {
  $name$_state begun, *state = &begun;
  $name$_output* out = &now->out;
  double values[INPUTS];
  absent(values);
  $name$_begin(state, values);
$prior$
}

static void predict(snapshot* now, double time) {
  $name$_state ahead = now->filter;
  $name$_output out;
  double values[INPUTS];
  absent(values);
  /* too far ahead to predict, the last outputs stay */
  if (now->begun && $name$_step(&ahead, time - now->sampled, values, &out) == $NAME$_OK) now->out = out;
}

static void take(snapshot* now, double time) {
  const double dt = now->begun ? time - now->sampled : 0.0;
  double values[INPUTS];
  int i, wild = 0, there = 0;
  if (now->begun && dt < 0.5 * $NAME$_INTERVAL) return;
  for (i = 0; i < INPUTS; ++i) { /* a wild value is a missing one */
    const double value = now->inputs[i];
    values[i] = value > $wild$ || value < -$wild$ ? NAN : value;
    wild |= value > $wild$ || value < -$wild$;
    there |= values[i] == values[i];
  }
  if (!now->begun && !there) return; /* not connected yet */
  if (!now->begun) $name$_begin(&now->filter, values), $name$_watch_begin(&now->watch);
  if ($name$_step(&now->filter, dt, values, &now->out) == $NAME$_OK) {
    now->health = $name$_health(&now->watch, &now->filter, dt, values, &now->out);
    if (wild && now->health < $NAME$_HEALTH_MISSING) now->health = $NAME$_HEALTH_MISSING;
  } else { /* a gap that is too long, or the filter left all bounds: it begins anew */
    $name$_restart(&now->filter, values);
    $name$_watch_begin(&now->watch);
    if ($name$_step(&now->filter, 0.0, values, &now->out)) now->filter.samples = 0;
    now->health = $NAME$_HEALTH_RESTARTED;
  }
  now->sampled = time;
  now->begun = 1;
}

EXPORT const char* fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible,
    bool logging, bool events, bool early, const fmi3ValueReference required[], size_t n, fmi3InstanceEnvironment where,
    fmi3LogMessageCallback log, fmi3Callback intermediate) {
  instance* self;
  if (!token || strcmp(token, "$token$")) {
    if (log) log(where, fmi3Error, "logStatusError", "the instantiation token is not this FMU's");
    return NULL;
  }
  self = malloc(sizeof *self);
  if (!self) return NULL;
  cleared(&self->now);
  self->environment = where;
  self->log = log;
  return self;
}

EXPORT void fmi3FreeInstance(fmi3Instance self) { free(self); }

static fmi3Status refused(fmi3Instance self, const char* why) {
  const instance* one = self;
  if (one && one->log) one->log(one->environment, fmi3Error, "logStatusError", why);
  return fmi3Error;
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance self, bool is, double tolerance, double start, bool stops, double stop) {
  ((instance*)self)->now.time = ((instance*)self)->now.sampled = start;
  return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance self) {
  take(&((instance*)self)->now, ((instance*)self)->now.time);
  return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance self, double time, double step, bool final, bool* events, bool* terminate, bool* early,
                             double* last) {
  snapshot* now = &((instance*)self)->now;
  if (!(step > 0.0 && time - time == 0.0)) return refused(self, "a step is longer than zero, from a finite time");
  if (now->sampled - time > 1e-9 * (1.0 + fabs(time))) return refused(self, "time goes back");
  take(now, time);
  *events = *terminate = *early = false;
  *last = now->time = time + step;
  predict(now, now->time);
  return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance self) {
  cleared(&((instance*)self)->now);
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance self, const fmi3ValueReference which[], size_t n, double values[], size_t many) {
  snapshot* now = &((instance*)self)->now;
  size_t i;
  if (n != many) return refused(self, "as many values as references");
  if (!now->begun) prior(now);
  const double told[OUTPUTS] = {$told$};
  for (i = 0; i < n; ++i) {
    if (which[i] > INPUTS + OUTPUTS) return refused(self, "no such number");
    values[i] = !which[i] ? now->time : which[i] <= INPUTS ? now->inputs[which[i] - 1] : told[which[i] - 1 - INPUTS];
  }
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance self, const fmi3ValueReference which[], size_t n, const double values[], size_t many) {
  size_t i;
  if (n != many) return refused(self, "as many values as references");
  for (i = 0; i < n; ++i) {
    if (which[i] < 1 || which[i] > INPUTS) return refused(self, "only inputs can be set");
    ((instance*)self)->now.inputs[which[i] - 1] = values[i];
  }
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetInt64(fmi3Instance self, const fmi3ValueReference which[], size_t n, int64_t values[], size_t many) {
  size_t i;
  if (n != many) return refused(self, "as many values as references");
  for (i = 0; i < n; ++i) {
    if (which[i] != INPUTS + OUTPUTS + 1) return refused(self, "no such number");
    values[i] = ((instance*)self)->now.health;
  }
  return fmi3OK;
}

/* what changes nothing here */
#define NOTHING(name) EXPORT fmi3Status name(fmi3Instance self) { return fmi3OK; }
NOTHING(fmi3Terminate)
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode)
NOTHING(fmi3EvaluateDiscreteStates)

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance self, bool on, size_t n, const fmi3String kinds[]) { return fmi3OK; }

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance self, bool* again, bool* terminate, bool* nominals, bool* values, bool* next,
                                           double* time) {
  *again = *terminate = *nominals = *values = *next = false;
  return fmi3OK;
}

/* what this FMU does not have: a tool that looks for all names of the standard finds them, and whatever it calls them with,
 * they refuse */
#define NONE(name) EXPORT fmi3Status name(fmi3Instance self) { return refused(self, #name " is not supported"); }
NONE(fmi3GetFloat32)
NONE(fmi3SetFloat32)
NONE(fmi3GetInt8)
NONE(fmi3SetInt8)
NONE(fmi3GetUInt8)
NONE(fmi3SetUInt8)
NONE(fmi3GetInt16)
NONE(fmi3SetInt16)
NONE(fmi3GetUInt16)
NONE(fmi3SetUInt16)
NONE(fmi3GetInt32)
NONE(fmi3SetInt32)
NONE(fmi3GetUInt32)
NONE(fmi3SetUInt32)
NONE(fmi3GetUInt64)
NONE(fmi3SetUInt64)
NONE(fmi3GetBoolean)
NONE(fmi3SetBoolean)
NONE(fmi3GetString)
NONE(fmi3SetString)
NONE(fmi3GetBinary)
NONE(fmi3SetBinary)
NONE(fmi3GetClock)
NONE(fmi3SetClock)
NONE(fmi3SetInt64)
NONE(fmi3EnterContinuousTimeMode)
NONE(fmi3GetIntervalDecimal)
NONE(fmi3GetIntervalFraction)
NONE(fmi3GetShiftDecimal)
NONE(fmi3GetShiftFraction)
NONE(fmi3SetIntervalDecimal)
NONE(fmi3SetIntervalFraction)
NONE(fmi3SetShiftDecimal)
NONE(fmi3SetShiftFraction)
NONE(fmi3GetOutputDerivatives)
NONE(fmi3GetDirectionalDerivative)
NONE(fmi3GetAdjointDerivative)
NONE(fmi3GetNumberOfVariableDependencies)
NONE(fmi3GetVariableDependencies)
NONE(fmi3CompletedIntegratorStep)
NONE(fmi3SetTime)
NONE(fmi3SetContinuousStates)
NONE(fmi3GetContinuousStateDerivatives)
NONE(fmi3GetEventIndicators)
NONE(fmi3GetContinuousStates)
NONE(fmi3GetNominalsOfContinuousStates)
NONE(fmi3GetNumberOfEventIndicators)
NONE(fmi3GetNumberOfContinuousStates)
NONE(fmi3ActivateModelPartition)
NONE(fmi3GetFMUState)
NONE(fmi3SetFMUState)
NONE(fmi3FreeFMUState)
NONE(fmi3SerializedFMUStateSize)
NONE(fmi3SerializeFMUState)
NONE(fmi3DeserializeFMUState)

#define NO_MODE(name) EXPORT fmi3Instance name(void) { return NULL; } /* this FMU is for co-simulation */
NO_MODE(fmi3InstantiateModelExchange)
NO_MODE(fmi3InstantiateScheduledExecution)
