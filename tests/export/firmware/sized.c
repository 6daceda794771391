/* What a product has: the filter, its state, and samples from somewhere. Linked to see how large it is, never run. */
#include FILTER_HEADER

static FILTER(state) state;
static volatile FILTER(real) port[FILTER_CHANNELS + 2];

int main(void) {
  FILTER(real) values[FILTER_CHANNELS];
  FILTER(output) out;
  int i, begun = 0;
  for (;;) {
    for (i = 0; i < FILTER_CHANNELS; ++i) values[i] = port[i];
    if (!begun) FILTER(begin)(&state, values);
    if (FILTER(step)(&state, begun ? FILTER_INTERVAL : 0, values, &out)) return 1;
    begun = 1;
    port[FILTER_CHANNELS] = out.angle;
    port[FILTER_CHANNELS + 1] = out.angle_std;
  }
}
