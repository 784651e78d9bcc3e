// What a board has to provide. A port to another microcontroller implements the functions of
// namespace `board` and nothing else; `main.cpp` and `core/` stay as they are.
#pragma once

#include <stdint.h>

#include "schema.h"

namespace softrobot {

struct BoardInfo {
  uint8_t n;              // tendons, 1 to kMostTendons
  uint32_t boot_id;       // another number after every start
  Reset reset_cause;
  uint16_t capabilities;  // bits of namespace capability
};

// Tendons beyond BoardInfo::n, and quantities without a capability, may hold anything.
struct Measured {
  int16_t length[kMostTendons];  // pulled in, 0.01 mm
  int16_t force[kMostTendons];   // 0.01 N
  uint16_t adc[kAdcChannels];
  uint16_t vbus;                 // supply of the servos, mV
  bool estop;                    // the switch is pressed, or its wire is broken
};

struct Outputs {
  bool powered;                     // false: no pulses, and no supply where it can be switched
  uint16_t pulse_us[kMostTendons];  // 0 without power
  int16_t applied[kMostTendons];    // length pulled in that the pulse stands for, 0.01 mm
  DeviceState state;
};

namespace board {

// Everything off; then clock, serial port, inputs, and a hardware watchdog of at most 120 ms.
void begin();

// Called once, after begin().
BoardInfo info();

// Microseconds; wraps at 2**32, and only there.
uint32_t now_us();

// Takes less than 2 ms.
void measure(Measured& measured);

// Called in every pass. Pulses end before the next pass if `powered` is false.
void apply(const Outputs& outputs);

// Received bytes, at most `room`; returns how many. Never waits.
uint8_t read(uint8_t* data, uint8_t room);

// Whether one more byte can be sent without waiting.
bool can_write();
void write(uint8_t byte);

void feed_watchdog();

}  // namespace board
}  // namespace softrobot
