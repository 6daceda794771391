/* What the example sketch uses of Arduino, so that it compiles and links for a Cortex-M4F without a board's core. */
#ifndef ARDUINO_H
#define ARDUINO_H

#define INPUT_PULLUP 2
#define CHANGE 1
enum { A0 = 14, A1, A2, A3, A4, A5, A6, A7, A8, A9, A10, A11 };

extern "C" {
extern volatile unsigned long board_clock;
extern volatile int board_pins[64];
}

inline unsigned long micros() { return board_clock; }
inline int digitalRead(int pin) { return board_pins[pin]; }
inline int analogRead(int pin) { return board_pins[pin]; }
inline void pinMode(int, int) {}
inline int digitalPinToInterrupt(int pin) { return pin; }
inline void attachInterrupt(int pin, void (*handler)(), int) { if (board_pins[pin]) handler(); }
inline void noInterrupts() {}
inline void interrupts() {}

struct Port {
  volatile float last;
  volatile const char* text;
  void begin(long) {}
  void print(const char* said) { text = said; }
  void print(float number) { last = number; }
  void println(const char* said) { text = said; }
};
extern Port Serial;

#endif
