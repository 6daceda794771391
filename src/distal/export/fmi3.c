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
typedef void* fmi3FMUState;
typedef void* fmi3InstanceEnvironment;
typedef uint32_t fmi3ValueReference;
typedef const char* fmi3String;
typedef const uint8_t* fmi3Binary;
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

/* all that a state of the FMU is: copied, kept and restored as it stands */
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

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance self, fmi3FMUState* state) {
  if (!*state) *state = malloc(sizeof(snapshot));
  if (!*state) return refused(self, "no memory");
  memcpy(*state, &((instance*)self)->now, sizeof(snapshot));
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance self, fmi3FMUState state) {
  memcpy(&((instance*)self)->now, state, sizeof(snapshot));
  return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance self, fmi3FMUState* state) {
  free(*state);
  *state = NULL;
  return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance self, fmi3FMUState state, size_t* size) {
  *size = sizeof(snapshot);
  return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance self, fmi3FMUState state, uint8_t bytes[], size_t size) {
  if (size < sizeof(snapshot)) return refused(self, "too few bytes for a state");
  memcpy(bytes, state, sizeof(snapshot));
  return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance self, const uint8_t bytes[], size_t size, fmi3FMUState* state) {
  if (size != sizeof(snapshot)) return refused(self, "these are not the bytes of a state");
  if (!*state) *state = malloc(sizeof(snapshot));
  if (!*state) return refused(self, "no memory");
  memcpy(*state, bytes, sizeof(snapshot));
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

/* what this FMU does not have; a tool that looks for all names of the standard finds them */
typedef const fmi3ValueReference* references;
#define NONE(name, ...) \
  EXPORT fmi3Status name(fmi3Instance self, __VA_ARGS__) { return refused(self, #name " is not supported"); }
#define TWO(name, x, y) NONE(name, x a, y b)
#define THREE(name, x, y, z) NONE(name, x a, y b, z c)
#define FOUR(name, x, y, z, u) NONE(name, x a, y b, z c, u d)
#define FIVE(name, x, y, z, u, v) NONE(name, x a, y b, z c, u d, v e)
#define ACCESS(kind, type) \
  FOUR(fmi3Get##kind, references, size_t, type*, size_t) \
  FOUR(fmi3Set##kind, references, size_t, const type*, size_t)
ACCESS(Float32, float)
ACCESS(Int8, int8_t)
ACCESS(UInt8, uint8_t)
ACCESS(Int16, int16_t)
ACCESS(UInt16, uint16_t)
ACCESS(Int32, int32_t)
ACCESS(UInt32, uint32_t)
ACCESS(UInt64, uint64_t)
ACCESS(Boolean, bool)
ACCESS(String, fmi3String)
FOUR(fmi3SetInt64, references, size_t, const int64_t*, size_t)
FIVE(fmi3GetBinary, references, size_t, size_t*, fmi3Binary*, size_t)
FIVE(fmi3SetBinary, references, size_t, const size_t*, const fmi3Binary*, size_t)
THREE(fmi3GetClock, references, size_t, bool*)
THREE(fmi3SetClock, references, size_t, const bool*)
FOUR(fmi3GetIntervalDecimal, references, size_t, double*, int*)
FIVE(fmi3GetIntervalFraction, references, size_t, uint64_t*, uint64_t*, int*)
THREE(fmi3GetShiftDecimal, references, size_t, double*)
FOUR(fmi3GetShiftFraction, references, size_t, uint64_t*, uint64_t*)
THREE(fmi3SetIntervalDecimal, references, size_t, const double*)
FOUR(fmi3SetIntervalFraction, references, size_t, const uint64_t*, const uint64_t*)
THREE(fmi3SetShiftDecimal, references, size_t, const double*)
FOUR(fmi3SetShiftFraction, references, size_t, const uint64_t*, const uint64_t*)
FIVE(fmi3GetOutputDerivatives, references, size_t, const int32_t*, double*, size_t)
#define DERIVATIVE(name) \
  NONE(name, references a, size_t b, references c, size_t d, const double* e, size_t f, double* g, size_t h)
DERIVATIVE(fmi3GetDirectionalDerivative)
DERIVATIVE(fmi3GetAdjointDerivative)
TWO(fmi3GetNumberOfVariableDependencies, fmi3ValueReference, size_t*)
NONE(fmi3GetVariableDependencies, fmi3ValueReference a, size_t* b, fmi3ValueReference* c, size_t* d, int* e, size_t f)
EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance self) { return refused(self, "there is no continuous time"); }
THREE(fmi3CompletedIntegratorStep, bool, bool*, bool*)
NONE(fmi3SetTime, double a)
TWO(fmi3SetContinuousStates, const double*, size_t)
TWO(fmi3GetContinuousStateDerivatives, double*, size_t)
TWO(fmi3GetEventIndicators, double*, size_t)
TWO(fmi3GetContinuousStates, double*, size_t)
TWO(fmi3GetNominalsOfContinuousStates, double*, size_t)
NONE(fmi3GetNumberOfEventIndicators, size_t* a)
NONE(fmi3GetNumberOfContinuousStates, size_t* a)
TWO(fmi3ActivateModelPartition, fmi3ValueReference, double)

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
                                                 fmi3InstanceEnvironment where, fmi3LogMessageCallback log) {
  if (log) log(where, fmi3Error, "logStatusError", "this FMU is for co-simulation");
  return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, bool visible,
    bool logging, fmi3InstanceEnvironment where, fmi3LogMessageCallback log, fmi3Callback update, fmi3Callback lock,
    fmi3Callback unlock) {
  if (log) log(where, fmi3Error, "logStatusError", "this FMU is for co-simulation");
  return NULL;
}
