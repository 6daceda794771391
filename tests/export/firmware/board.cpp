/* A board that does nothing but call the sketch, as Arduino's core does. */
#include "Arduino.h"

extern "C" {
volatile unsigned long board_clock;
volatile int board_pins[64];
}
Port Serial;

void setup();
void loop();

int main() {
  setup();
  for (;;) loop();
}
