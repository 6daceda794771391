/* What a product has: the filter, its state, and samples from somewhere. Linked to see how large it is, never run. */
#include FILTER_HEADER

static FILTER(state) state;
static volatile FILTER(real) port[FILTER_CHANNELS + FILTER_STATES];

int main(void) {
  FILTER(real) values[FILTER_CHANNELS];
  FILTER(output) out;
  int i, begun = 0;
  for (;;) {
    for (i = 0; i < FILTER_CHANNELS; ++i) values[i] = port[i];
    if (!begun) FILTER(begin)(&state, values);
    if (FILTER(step)(&state, begun ? FILTER_INTERVAL : 0, values, &out)) return 1;
    begun = 1;
    {
      const FILTER(real) told[] = {FILTER_TOLD(out)};
      for (i = 0; i < (int)(sizeof told / sizeof *told); ++i) port[FILTER_CHANNELS + i] = told[i];
    }
  }
}
