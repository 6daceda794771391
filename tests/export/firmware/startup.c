/* The least a Cortex-M4F needs: vectors, FPU on, data copied, stack painted, and semihosting to speak to the host. */
#include <stdint.h>

extern uint32_t stack_low[], stack_top[], data_from[], data_low[], data_high[], bss_low[], bss_high[];
int main(void);

#define CPACR (*(volatile uint32_t*)0xE000ED88u)
#define PAINT 0x5AFEC0DEu

static void stop(int code) {
  /* SYS_EXIT_EXTENDED (0x20), ADP_Stopped_ApplicationExit */
  const uint32_t block[2] = {0x20026u, (uint32_t)code};
  register uint32_t r0 __asm__("r0") = 0x20u;
  register const uint32_t* r1 __asm__("r1") = block;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  for (;;) {
  }
}

__attribute__((naked)) void reset(void) {
  __asm__ volatile("ldr sp, =stack_top\n  b begin");
}

void begin(void) {
  uint32_t *to, *from = data_from;
  CPACR |= 0xFu << 20;
  __asm__ volatile("dsb\n  isb");
  for (to = data_low; to < data_high;) *to++ = *from++;
  for (to = bss_low; to < bss_high;) *to++ = 0;
  for (to = stack_low; to < (uint32_t*)__builtin_frame_address(0) - 16;) *to++ = PAINT;
  stop(main());
}

/* bytes of stack that were ever written */
uint32_t stack_used(void) {
  const uint32_t* at = stack_low;
  while (at < stack_top && *at == PAINT) ++at;
  return (uint32_t)((const char*)stack_top - (const char*)at);
}

static void fault(void) { stop(99); }

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))stack_top, reset, fault, fault, fault, fault, fault};
