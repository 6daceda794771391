/* The filter over a log that is linked in; angles as the bits of floats, then instructions and stack, to the host. */
#include <stdint.h>
#include <string.h>
#include FILTER_HEADER
#include "log.h" /* SAMPLES, steps[SAMPLES], samples[SAMPLES][FILTER_CHANNELS] */

uint32_t stack_used(void);

#define SYST_CSR (*(volatile uint32_t*)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t*)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t*)0xE000E018u)

static FILTER(state) state;

static void say(const char* text) {
  register uint32_t r0 __asm__("r0") = 0x04u; /* SYS_WRITE0 */
  register const char* r1 __asm__("r1") = text;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void number(uint32_t value) {
  char text[10];
  int i;
  for (i = 0; i < 8; ++i) text[i] = "0123456789abcdef"[(value >> (28 - 4 * i)) & 15u];
  text[8] = ' ';
  text[9] = 0;
  say(text);
}

static uint32_t bits(FILTER(real) value) {
  const float single = (float)value;
  uint32_t as;
  memcpy(&as, &single, sizeof as);
  return as;
}

/* how many ticks 1,000,000 instructions take */
static uint32_t million(void) {
  const uint32_t before = SYST_CVR;
  uint32_t count = 500000u;
  __asm__ volatile("1: subs %0, %0, #1\n  bne 1b" : "+r"(count) : : "cc");
  return (before - SYST_CVR) & 0xFFFFFFu;
}

int main(void) {
  uint32_t used = 0, ticks = 0, most = 0, stack;
  int i, k;
  FILTER(output) out;
  SYST_RVR = 0xFFFFFFu;
  SYST_CVR = 0;
  SYST_CSR = 5u; /* processor clock, no interrupt */
  FILTER(begin)(&state, samples[0]);
  for (k = 0; k < SAMPLES; ++k) {
    const uint32_t before = SYST_CVR;
    const int code = FILTER(step)(&state, steps[k], samples[k], &out);
    ticks = (before - SYST_CVR) & 0xFFFFFFu;
    used += ticks;
    if (ticks > most) most = ticks;
    if (code) return 10 + code;
    stack = stack_used();
    {
      const FILTER(real) told[] = {FILTER_TOLD(out)};
      for (i = 0; i < (int)(sizeof told / sizeof *told); ++i) number(bits(told[i]));
      say("\n");
    }
  }
  say("ticks ");
  number(used);
  number(most);
  number(stack);
  number(million());
  say("\n");
  return 0;
}
