// Timer 1: the clock and the pulses of the servos.
#pragma once

#include <stdint.h>

namespace softrobot {
namespace timer {

void begin();

// Microseconds; wraps at 2**32.
uint32_t now_us();

// Pulses every 20 ms; 0 for none.
void set_pulses(const uint16_t* pulse_us);

// No pulses from now on, not even the rest of one.
void stop_pulses();

}  // namespace timer
}  // namespace softrobot
